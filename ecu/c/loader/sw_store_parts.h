/* What the store's sources share; not for callers. */
#ifndef SW_STORE_PARTS_H
#define SW_STORE_PARTS_H

#include "sw_bytes.h"
#include "sw_store.h"

#define SW_NO_OFFSET 0xffffffffu

/* sw_state.c */
void sw_state_empty(sw_store_state *state);
void sw_state_empty_slot(sw_slot_state *slot);
void sw_state_open(sw_store *store);
/* A copy of the state in the scratch memory, to be changed and kept. */
sw_store_state *sw_state_draft(sw_store *store);
/* 1: it cannot be kept, and the one before counts. */
int sw_state_keep(sw_store *store, const sw_store_state *next);
int sw_state_slots_equal(const sw_slot_state *one, const sw_slot_state *other);
uint32_t sw_state_in_phase(const sw_store_state *state, sw_phase phase); /* SW_NO_SLOT: none is */
uint32_t sw_state_next_boot(const sw_store_state *state);
void sw_state_give_up(sw_slot_state *slot);

/* sw_slots.c */
/* Where writing behind the first bytes can go on: behind all of them, or at a sector's start; SW_NO_OFFSET: nowhere. */
uint32_t sw_slots_begin_again(const sw_store *store, uint32_t slot);
/* Begins; 1: the memory failed. */
int sw_slots_erase(sw_store *store, uint32_t slot, uint32_t sector);
/* Write the bytes of a slot from `from` on; `tail` are the bytes of its last word that is not whole. 1: the memory failed. */
int sw_slots_append(const sw_store *store, uint32_t slot, uint32_t from, uint8_t *tail, const uint8_t *data,
                    uint32_t length);
uint32_t sw_slots_address(uint32_t slot);

/* sw_judge.c */
void sw_judge_begin(sw_store *store, uint32_t slot);
/* One piece; 1: there is more to do. */
int sw_judge_go_on(sw_store *store);
/* All of it at once. */
sw_verdict sw_judge_slot(sw_store *store, uint32_t slot);
/* Once it is done; the header of a good one stands in the scratch memory. */
sw_verdict sw_judge_end(sw_store *store);

#endif

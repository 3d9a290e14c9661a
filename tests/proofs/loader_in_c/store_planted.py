"""Faults that are planted in the store's C, one at a time: the comparison, or the cuts, have to notice every one."""

from pathlib import Path
from typing import Final

from tests.proofs.ecu_in_c.planted import Planted
from tests.proofs.loader_in_c.store_library import Library, built, sources
from tests.proofs.loader_in_c.store_pair import Pair
from tests.proofs.loader_in_c.store_stories import Cuts, any_calls

_HEAD: Final = (
    "sw_bytes_fill(head, 0, WORD); sw_bytes_copy(head, sector_magic, SEQUENCE); sw_put_big_u32(&head[SEQUENCE], "
    "next.sequence); sw_put_big_u32(&head[SECTOR_CRC], sw_crc32(0, head, SECTOR_CRC));"
)
_BLANKED: Final = "if (blanked(records, next.sector) != 0) return 1;"
_PLACES: Final = (
    ("a torn record counts", "sw_records.c", "return crc == sw_big_u32(&first[CRC]);", "return crc != 1u;"),
    ("the older sector counts", "sw_records.c", "sequence > records->sequence", "sequence < records->sequence"),
    ("a full sector takes a wrong kind along", "sw_records.c", "i + 1u == (uint32_t)kind", "i == (uint32_t)kind"),
    ("the first word makes a sector valid too early", "sw_records.c", _BLANKED,
     f"{_BLANKED} {_HEAD} return write_word(records, next.sector, 0, head);"),
    ("boots on trial do not end", "sw_boot.c", "        next->slots[slot].boots_left--;\n", ""),
    ("an image that fails runs", "sw_boot.c", "if (store->verdicts[slot] == SW_VERDICT_GOOD) return 1;", "return 1;"),
    ("the one before is not tried", "sw_boot.c", "i < 2u && store->running", "i < 1u && store->running"),
    ("words are written on unseen", "sw_slots.c", "at < standing->length; at += WORD", "at < begin; at += WORD"),
    ("a sector's part stays", "sw_slots.c", "/ SW_FLASH_SECTOR * SW_FLASH_SECTOR;", "/ WORD * WORD;"),
    ("one sector is not erased", "sw_store.c", "store->at < SW_SLOT_SECTORS ?", "store->at + 1u < SW_SLOT_SECTORS ?"),
    ("bytes behind a word are lost", "sw_state.c",
     "sw_bytes_copy(state->tail[i], &data[at + i * SW_FLASH_WORD], SW_FLASH_WORD);",
     "sw_bytes_fill(state->tail[i], 0, SW_FLASH_WORD);"),
    ("what cannot be read is good", "sw_judge.c", "store->verdict = SW_VERDICT_UNREADABLE;",
     "store->verdict = SW_VERDICT_GOOD;"),
    ("a hash is not compared", "sw_judge.c", "!sw_bytes_equal(whole, standing->sha256, 32)",
     "whole[0] == 1u && whole[1] == 1u"),
    ("the same version is too old", "sw_release.c", "< least_security_version ?", "<= least_security_version ?"),
    ("anyone may sign", "sw_release.c", "if (sw_key_is_allowed(keys, &header[SIGNER])) return SW_VERDICT_GOOD;",
     "return SW_VERDICT_GOOD;"),
    ("any signature is good", "sw_signature.c",
     "return crypto_verify32(found, signature) == 0;", "return crypto_verify32(found, signature) != 2;"),
    ("an old list is taken", "sw_remembered.c", "<= sw_key_list_version(store->keys)", "< 1u"),
    ("a needed key goes", "sw_remembered.c", "!sw_key_is_allowed(data, signer)) return",
     "length == 0u) return"),
    ("calibrations stand in no order", "sw_remembered.c", "return one[i] < other[i];", "return one[i] > other[i];"),
    ("a release leads back to itself", "sw_store.c",
     "store->running != SW_NO_SLOT ? store->running : store->state.active",
     "store->state.active"),
    ("the security version does not rise", "sw_store.c", "> next->least_security_version",
     "< next->least_security_version"),
    ("a protected slot is written", "sw_store.c", "return 1u - running;", "return running;"),
)  # fmt: skip
PLANTED: Final = tuple(Planted(what, "", file, old, new) for what, file, old, new in _PLACES)


def is_found(item: Planted, folder: Path) -> bool:
    """By calls at random, or by cuts."""
    # A fault may look odd to the compiler.
    flags = ("-O1", "-shared", "-fPIC", "-w")
    library = Library(built(folder / f"planted_{PLANTED.index(item)}.so", item.into(sources()), flags))
    try:
        for seed in range(6):
            any_calls(Pair(library), str(seed), 150)
        return bool(Cuts(library, 0, every=5).findings)
    except AssertionError:
        return True

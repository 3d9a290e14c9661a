/* A polling driver of Bosch's CAN controller M_CAN (user's manual, revision 3.3). Received frames come through FIFO 0.
 * Each control frame has a separate transmit buffer. Other frames go through the transmit FIFO, which follows these
 * buffers. Whenever the bus is free, the controller compares the buffers' frames and the FIFO's first frame, and sends
 * the frame with the lowest identifier. Each element of the message RAM has room for 64 bytes of data.
 */
#include <stddef.h>

#include "sw_board.h"

#define CAN(offset) SW_BOARD_REGISTER(SW_BOARD_CAN + (offset))
#define STAMPS(offset) SW_BOARD_REGISTER(SW_BOARD_STAMPS + (offset))
#define RAM(word) SW_BOARD_REGISTER(SW_BOARD_CAN_RAM + 4u * (word))

#define TIMER_CR1 0x00u
#define TIMER_EGR 0x14u
#define TIMER_PSC 0x28u
#define DBTP 0x00cu
#define CCCR 0x018u
#define NBTP 0x01cu
#define TSCC 0x020u
#define TSCV 0x024u
#define ECR 0x040u
#define PSR 0x044u
#define TDCR 0x048u
#define IR 0x050u
#define IE 0x054u
#define ILE 0x05cu
#define GFC 0x080u
#define SIDFC 0x084u
#define XIDFC 0x088u
#define RXF0C 0x0a0u
#define RXF0S 0x0a4u
#define RXF0A 0x0a8u
#define RXESC 0x0bcu
#define TXBC 0x0c0u
#define TXFQS 0x0c4u
#define TXESC 0x0c8u
#define TXBRP 0x0ccu
#define TXBAR 0x0d0u
#define TXBCR 0x0d4u

#define CCCR_INIT 1u
#define CCCR_CCE 2u
#define CCCR_FD_AND_BRS 0x300u
#define PSR_BUS_OFF 0x80u
#define IR_NEW_IN_FIFO_0 1u
#define IR_BUS_OFF 0x2000000u /* set when the bus-off state changes */
#define MOST_BUS_OFFS 8u      /* largest number of bus-off events counted per call */
#define REFUSE_REMOTE_AND_OTHERS 0x2bu             /* GFC: refuses remote frames and frames that match no filter */
#define FILTER_TO_FIFO_0 ((2u << 30) | (1u << 27)) /* filter type "classic": identifier and mask */
#define EXTENDED_TO_FIFO_0 (1u << 29)              /* first word of a 29-bit filter, with the identifier */
#define EXTENDED_MASK ((2u << 30) | 0x1fffffffu)   /* second word of a 29-bit filter: type "classic", and the mask */
#define ELEMENT_64_BYTES 7u
#define STANDARD_SHIFT 18u
#define XTD 0x40000000u
#define FDF 0x200000u
#define BRS 0x100000u

/* Offsets in the message RAM, in words. The RAM has 64 filters for 11-bit identifiers, 32 filters for 29-bit
 * identifiers, 64 elements for received frames, and the elements for frames to send.
 */
#define FILTERS 0u
#define EXTENDED_FILTERS 64u
#define RECEIVED 128u
#define RECEIVED_ELEMENTS 64u
#define WORDS 18u
#define SENT (RECEIVED + RECEIVED_ELEMENTS * WORDS)
#define OF_CONTROL ((uint32_t)SW_FRAMES_OUT)
#define IN_FIFO 8u

static const uint8_t lengths[16] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};

static void set_filters(const uint32_t *ids, uint32_t count)
{
    uint32_t extended = 0, standard = 0;
    for (uint32_t i = 0; i < count; i++) {
        if ((ids[i] & SW_BOARD_EXTENDED) != 0u) {
            RAM(EXTENDED_FILTERS + 2u * extended) = EXTENDED_TO_FIFO_0 | (ids[i] & 0x1fffffffu);
            RAM(EXTENDED_FILTERS + 2u * extended + 1u) = EXTENDED_MASK;
            extended++;
        } else {
            RAM(FILTERS + standard) = FILTER_TO_FIFO_0 | (ids[i] << 16) | 0x7ffu;
            standard++;
        }
    }
    CAN(SIDFC) = (standard << 16) | (4u * FILTERS);
    CAN(XIDFC) = (extended << 16) | (4u * EXTENDED_FILTERS);
}

void sw_board_can_start(const uint32_t *ids, uint32_t count)
{
    CAN(CCCR) = CCCR_INIT;
    while ((CAN(CCCR) & CCCR_INIT) == 0u) {
    }
    CAN(CCCR) = CCCR_INIT | CCCR_CCE | CCCR_FD_AND_BRS;
    CAN(NBTP) = SW_BOARD_CAN_NOMINAL;
    CAN(DBTP) = SW_BOARD_CAN_DATA;
    CAN(TDCR) = SW_BOARD_CAN_DELAY;
    /* The internal counter counts bits, whose duration changes within a frame of CAN FD. */
    STAMPS(TIMER_PSC) = SW_BOARD_STAMP_CLOCKS - 1u;
    STAMPS(TIMER_EGR) = 1u; /* takes over the prescaler */
    STAMPS(TIMER_CR1) = 1u;
    CAN(TSCC) = 2u; /* time stamps from the external counter */
    set_filters(ids, count);
    CAN(GFC) = REFUSE_REMOTE_AND_OTHERS;
    CAN(RXF0C) = (RECEIVED_ELEMENTS << 16) | (4u * RECEIVED);
    CAN(RXESC) = ELEMENT_64_BYTES;
    CAN(TXBC) = (IN_FIFO << 24) | (OF_CONTROL << 16) | (4u * SENT);
    CAN(TXESC) = ELEMENT_64_BYTES;
    CAN(IE) = IR_NEW_IN_FIFO_0;
    CAN(ILE) = 1u;
    CAN(CCCR) = CCCR_FD_AND_BRS;
}

static void read_element(sw_frame *frame, uint32_t at)
{
    const uint32_t first = RAM(at), second = RAM(at + 1u);
    frame->is_extended = (first & XTD) != 0u;
    frame->id = frame->is_extended != 0u ? first & 0x1fffffffu : (first >> STANDARD_SHIFT) & 0x7ffu;
    frame->is_fd = (second & FDF) != 0u;
    const uint8_t code = (uint8_t)((second >> 16) & 15u);
    frame->length = frame->is_fd != 0u || code < 8u ? lengths[code] : 8u;
    for (uint32_t i = 0; i < frame->length; i += 4u) {
        const uint32_t word = RAM(at + 2u + i / 4u);
        for (uint32_t j = 0; j < 4u; j++) frame->data[i + j] = (uint8_t)(word >> (8u * j));
    }
    /* The counter has 16 bits, so a frame must be read within 131 ms after its arrival. */
    const uint32_t age = (CAN(TSCV) - second) & 0xffffu;
    frame->timestamp_ns = sw_board_now_ns() - (int64_t)age * (int64_t)SW_BOARD_CAN_NS;
}

int sw_board_can_receive(sw_frame *frames, int room)
{
    int count = 0;
    CAN(IR) = IR_NEW_IN_FIFO_0;
    while (count < room) {
        const uint32_t status = CAN(RXF0S), index = (status >> 8) & 63u;
        if ((status & 127u) == 0u) break;
        read_element(&frames[count], RECEIVED + index * WORDS);
        CAN(RXF0A) = index;
        count++;
    }
    return count;
}

static uint32_t code_of(uint8_t length)
{
    uint32_t code = 0;
    while (code < 15u && lengths[code] < length) code++;
    return code;
}

static void put(const sw_frame *frame, uint32_t index)
{
    const uint32_t at = SENT + index * WORDS;
    RAM(at) = frame->is_extended != 0u ? XTD | frame->id : frame->id << STANDARD_SHIFT;
    RAM(at + 1u) = (code_of(frame->length) << 16) | (frame->is_fd != 0u ? FDF | BRS : 0u);
    for (uint32_t i = 0; i < frame->length; i += 4u) {
        uint32_t word = 0;
        for (uint32_t j = 0; j < 4u; j++) word |= (uint32_t)frame->data[i + j] << (8u * j);
        RAM(at + 2u + i / 4u) = word;
    }
    CAN(TXBAR) = UINT32_C(1) << index;
}

static int is_off(void) { return (CAN(PSR) & PSR_BUS_OFF) != 0u; }

volatile uint32_t sw_board_lost;

int sw_board_can_send(const sw_frame *frame, uint32_t place)
{
    /* Frames that wait while the controller is bus-off would be sent too late, so they are cancelled. */
    const int off = is_off();
    const uint32_t mine = UINT32_C(1) << place, old = CAN(TXBRP) & (off ? UINT32_MAX : mine);
    if (old != 0u) CAN(TXBCR) = old;
    const uint32_t left = CAN(TXBRP) & mine;
    if ((old & mine) != left) sw_board_lost++; /* the older frame was cancelled */
    if (off || left != 0u) {
        sw_board_lost++;
        return 1;
    }
    put(frame, place);
    return 0;
}

int sw_board_can_room(void) { return is_off() ? 0 : (int)(CAN(TXFQS) & 63u); }

void sw_board_can_queue(const sw_frame *frame) { put(frame, (CAN(TXFQS) >> 16) & 31u); }

int sw_board_can_is_idle(void) { return CAN(TXBRP) == 0u || is_off(); }

void sw_board_can_health(sw_bus_health *health)
{
    /* A bus-off sets INIT. Clearing INIT begins the recovery, which lasts 128 times eleven recessive bits. The loop
     * looks for further bus-offs in IR, since INIT, in another clock domain, changes late. If INIT is not set yet, the
     * event stays in IR for the next call: otherwise nothing would ever begin the recovery.
     */
    for (uint32_t i = 0; i < MOST_BUS_OFFS && (CAN(IR) & IR_BUS_OFF) != 0u; i++) {
        const int is_stopped = (CAN(CCCR) & CCCR_INIT) != 0u;
        if (!is_stopped && is_off()) break;
        CAN(IR) = IR_BUS_OFF;
        if (is_stopped) {
            if (health->bus_off < UINT32_MAX) health->bus_off++;
            CAN(CCCR) = CCCR_FD_AND_BRS;
        }
    }
    const uint32_t errors = CAN(ECR);
    health->is_bus_off = (uint8_t)is_off();
    health->tx_errors = errors & 0xffu;
    /* The 7-bit counter counts at most 127 receive errors; bit RP is set from 128 errors on. */
    health->rx_errors = ((errors >> 15) & 1u) != 0u ? 128u : (errors >> 8) & 0x7fu;
}

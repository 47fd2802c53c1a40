//! The serial line to the host: USART1, a queue of bytes each way, one interrupt for both.
//!
//! The interrupt fetches each received byte before the next is complete (11 µs at 921600 baud; there is no deeper
//! memory), which is why it ranks above the sampler. Sending starts by raising the same interrupt from software: it
//! fills the transmitter and then lives on "transmitter empty" until the queue is empty. An emulator without that
//! second interrupt takes all bytes in the first.

use cortex_m::peripheral::NVIC;
use heapless::spsc::{Consumer, Producer, Queue};
use stm32f4::stm32f405::{Interrupt, USART1, interrupt};

use super::handover::Handover;

/// Places for received bytes, one of them never used: two commands of the longest kind.
pub(super) const RECEIVED: usize = 128;

/// Places for bytes to send, one of them never used: 2.7 ms at 921600 baud.
pub(super) const TO_SEND: usize = 256;

/// Priority of the interrupt, in the upper four bits.
const PRIORITY: u8 = 0x10;

/// What the interrupt owns.
struct Wire {
    uart: USART1,
    received: Producer<'static, u8>,
    to_send: Consumer<'static, u8>,
}

static WIRE: Handover<Wire> = Handover::new();

/// The main loop's end.
pub(super) struct Line {
    received: Consumer<'static, u8>,
    to_send: Producer<'static, u8>,
}

/// The queues of bytes: received, and to be sent.
type Queues = (&'static mut Queue<u8, RECEIVED>, &'static mut Queue<u8, TO_SEND>);

/// Starts the serial line at the speed that the divider gives.
pub(super) fn start(uart: USART1, divider: u16, (received, to_send): Queues, interrupts: &mut NVIC) -> Line {
    // SAFETY: the divider as RM0090, section 30.3.4, has it: mantissa and fraction are one number of sixteenths.
    #[expect(unsafe_code, reason = "the register's numeric fields are not checked by the access crate")]
    uart.brr().write(|w| unsafe { w.bits(divider) });
    uart.cr1().write(|w| w.ue().set_bit().te().set_bit().re().set_bit().rxneie().set_bit());
    let (received_in, received) = received.split();
    let (to_send, to_send_out) = to_send.split();
    WIRE.leave(Wire { uart, received: received_in, to_send: to_send_out });
    // SAFETY: no critical section is built on priorities.
    #[expect(unsafe_code, reason = "priorities can break critical sections that are built on them; none are")]
    unsafe {
        interrupts.set_priority(Interrupt::USART1, PRIORITY);
        NVIC::unmask(Interrupt::USART1);
    }
    Line { received, to_send }
}

impl Line {
    /// What has come, as much as fits.
    pub(super) fn receive<'b>(&mut self, buffer: &'b mut [u8]) -> &'b [u8] {
        let mut length = 0;
        for (place, byte) in buffer.iter_mut().zip(core::iter::from_fn(|| self.received.dequeue())) {
            *place = byte;
            length += 1;
        }
        &buffer[..length]
    }

    /// Takes as many of these bytes as there is room for; tells how many.
    pub(super) fn send(&mut self, bytes: &[u8]) -> usize {
        let taken = bytes.iter().take_while(|&&byte| self.to_send.enqueue(byte).is_ok()).count();
        if taken > 0 {
            NVIC::pend(Interrupt::USART1);
        }
        taken
    }

    /// Whether something has come.
    pub(super) fn has_received(&self) -> bool {
        self.received.ready()
    }

    /// Whether the interrupt has taken all bytes.
    pub(super) fn is_idle(&self) -> bool {
        self.to_send.is_empty()
    }
}

impl Wire {
    /// A byte came, or one may go.
    fn interrupt(&mut self) {
        let status = self.uart.sr().read();
        // After an overrun the byte must be read as well, or the interrupt comes for ever.
        if status.rxne().bit_is_set() || status.ore().bit_is_set() {
            let [byte, ..] = self.uart.dr().read().bits().to_le_bytes();
            // A command that finds no room is damaged, and the host repeats it.
            let _ = self.received.enqueue(byte);
        }
        // As many as can wait: no loop without end, whatever the transmitter says.
        for _ in 0..TO_SEND {
            if self.uart.sr().read().txe().bit_is_clear() {
                break;
            }
            let Some(byte) = self.to_send.dequeue() else { break };
            // SAFETY: nine bits, the upper one unused.
            #[expect(unsafe_code, reason = "the register's numeric fields are not checked by the access crate")]
            self.uart.dr().write(|w| unsafe { w.bits(u16::from(byte)) });
        }
        let more = self.to_send.ready();
        self.uart.cr1().modify(|_, w| w.txeie().bit(more));
    }
}

#[interrupt]
fn USART1() {
    static mut OWN: Option<Wire> = None;
    if OWN.is_none() {
        *OWN = WIRE.fetch();
    }
    if let Some(wire) = OWN {
        wire.interrupt();
    }
}

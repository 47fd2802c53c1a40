//! The sampler alone, with a bus that can be tampered with frame by frame.

use core::cell::RefCell;
use std::boxed::Box;
use std::vec::Vec;

use embedded_hal::delay::DelayNs;
use embedded_hal::spi::{ErrorType, Operation, SpiDevice};
use palpate_shared::sim::{Faults, FingerConfig, FloatingBus, PortBusy, SimulatedFrontEnd, SpiPort};

use super::*;
use crate::ads131m::Ads131m02;
use crate::front_end::{SelectSource, SourceNotPossible};
use crate::queues::{DeviceEnd, Queues};
use crate::settings::ConverterClock;
use crate::test_chip::on_chip_of;

/// What happens to the bytes of a frame on their way.
type Tamper<'a> = Box<dyn FnMut(&mut [u8]) + 'a>;

struct Bus<'a> {
    port: SpiPort<'a>,
    /// From the firmware to the chip.
    on_the_way_out: Tamper<'a>,
    /// From the chip to the firmware.
    on_the_way_in: Tamper<'a>,
}

impl ErrorType for Bus<'_> {
    type Error = PortBusy;
}

impl SpiDevice for Bus<'_> {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), PortBusy> {
        if let [Operation::TransferInPlace(bytes), ..] = operations {
            (self.on_the_way_out)(bytes);
        }
        self.port.transaction(operations)?;
        if let [Operation::TransferInPlace(bytes), ..] = operations {
            (self.on_the_way_in)(bytes);
        }
        Ok(())
    }
}

impl DelayNs for Bus<'_> {
    fn delay_ns(&mut self, duration_ns: u32) {
        self.port.delay_ns(duration_ns);
    }
}

impl SelectSource for Bus<'_> {
    fn select(&mut self, _: Source) -> Result<(), SourceNotPossible> {
        Err(SourceNotPossible)
    }

    fn is_simulated(&self) -> bool {
        false
    }
}

/// A sampler that streams at 4 kHz, its chip, and the main side's end of the queues.
struct Setup<'a> {
    front_end: &'a RefCell<SimulatedFrontEnd>,
    sampler: Sampler<'a, Ads131m02<Bus<'a>>>,
    main: DeviceEnd<'a>,
    /// µs.
    time: u32,
}

impl<'a> Setup<'a> {
    fn new(front_end: &'a RefCell<SimulatedFrontEnd>, queues: &'a mut Queues) -> Self {
        let (end, main) = queues.split();
        let bus =
            Bus { port: SpiPort::new(front_end), on_the_way_out: Box::new(|_| ()), on_the_way_in: Box::new(|_| ()) };
        let mut sampler = Sampler::new(Ads131m02::new(bus), end, DeviceSettings::at_start(0, ConverterClock::NOMINAL));
        sampler.idle(DeviceTime(0));
        sampler.streaming = true;
        Self { front_end, sampler, main, time: 0 }
    }

    /// Conversions pass, and their edges come `late` µs.
    fn run_late(&mut self, conversions: u32, late: u32) {
        for _ in 0..conversions {
            self.time = self.time.wrapping_add(250);
            if self.front_end.borrow_mut().step() {
                self.sampler.data_ready(DeviceTime(self.time.wrapping_add(late)));
            }
        }
    }

    fn run(&mut self, conversions: u32) {
        self.run_late(conversions, 0);
    }

    /// A conversion passes, and its edge is missed.
    fn miss(&mut self) {
        self.time = self.time.wrapping_add(250);
        self.front_end.borrow_mut().step();
    }

    fn numbers(&mut self) -> Vec<u32> {
        core::iter::from_fn(|| self.main.reading()).map(|reading| reading.seq.0).collect()
    }

    fn events(&mut self) -> Vec<EventKind> {
        let notices = core::iter::from_fn(|| self.main.notice());
        notices.filter_map(|notice| if let Notice::Event { kind, .. } = notice { Some(kind) } else { None }).collect()
    }

    /// Findings of the answers that came.
    fn findings(&mut self) -> Vec<Finding> {
        let notices = core::iter::from_fn(|| self.main.notice());
        notices
            .filter_map(|notice| if let Notice::Answer { finding, .. } = notice { Some(finding) } else { None })
            .collect()
    }
}

/// Runs a test on a chip of its own.
fn setup(test: impl FnOnce(Setup<'_>)) {
    let front_end = RefCell::new(SimulatedFrontEnd::new(on_chip_of(module_path!(), FingerConfig::ideal()), 1));
    let mut queues = Queues::new();
    test(Setup::new(&front_end, &mut queues));
}

#[test]
fn numbers_run_on_across_their_wrap() {
    setup(|mut on| {
        let start = Seq(u32::MAX - 49);
        on.sampler.next = start;
        on.run(40);
        on.miss();
        on.run(19); // the wrap is at 50
        on.miss();
        on.run(39);
        let wanted: Vec<u32> = (0..100).filter(|n| ![40, 60].contains(n)).map(|n| start.plus(n).0).collect();
        assert_eq!(on.numbers(), wanted);
        assert_eq!(on.main.tally().missed, 2);
    });
}

#[test]
fn a_main_side_that_does_not_come_by_costs_counted_samples_only() {
    setup(|mut on| {
        on.run(1000);
        let tally = on.main.tally();
        assert!(on.numbers().into_iter().eq(0..127));
        assert_eq!((tally.samples, tally.dropped, tally.missed, tally.damaged), (1000, 1000 - 127, 0, 0));
    });
}

#[test]
fn an_edge_served_late_is_not_taken_for_a_missed_one() {
    setup(|mut on| {
        for _ in 0..10 {
            on.run(5);
            on.run_late(1, 140); // 390 µs after the last: more than one and a half periods
        }
        assert!(on.numbers().into_iter().eq(0..60));
        assert_eq!(on.main.tally().missed, 0);
    });
}

#[test]
fn a_write_that_damage_made_and_damage_hid_is_found_and_undone() {
    setup(|mut on| {
        on.run(10);
        let mut write = [0; 12]; // WREG GAIN1 0000; its CRC does not matter to the chip
        write[0] = 0x62;
        SpiPort::new(on.front_end).write(&write).unwrap();
        assert_eq!(on.front_end.borrow().chip().gain(0), 1);
        // The frame that would acknowledge the write comes damaged.
        on.front_end.borrow_mut().set_faults(Faults { bit_error_rate: 1.0, ..Faults::default() });
        on.run(1);
        on.front_end.borrow_mut().set_faults(Faults::default());
        on.run(10);
        assert_eq!(on.front_end.borrow().chip().gain(0), 32);
        assert_eq!(on.events(), [EventKind::FrontEndReset]);
    });
}

#[test]
fn a_read_that_damage_made_a_write_is_undone() {
    setup(|mut on| {
        on.run(10);
        let mut left = 1;
        on.sampler.bus_mut().on_the_way_out = Box::new(move |bytes| {
            if left > 0 && bytes[0] == 0xA2 {
                bytes[0] = 0x62; // RREG GAIN1 becomes WREG GAIN1
                left -= 1;
            }
        });
        assert!(on.main.request(FrontEndRequest { ticket: 1, kind: RequestKind::ReadRegister(4) }));
        on.run(20);
        assert_eq!(on.front_end.borrow().chip().peek(4), 0x55);
        assert_eq!(on.events(), [EventKind::FrontEndReset]);
    });
}

#[test]
fn a_write_that_strays_during_initialisation_is_noticed() {
    setup(|mut on| {
        let mut left = 1;
        on.sampler.bus_mut().on_the_way_out = Box::new(move |bytes| {
            if left > 0 && bytes[..2] == [0x61, 0x80] {
                bytes[0] = 0x65; // WREG CLOCK goes to channel 0's offset; CLOCK reads right by its default
                left -= 1;
            }
        });
        on.sampler.restore_settings(DeviceTime(0));
        assert_eq!(on.front_end.borrow().chip().peek(0x0B), 0);
        assert_eq!(on.events(), [EventKind::FrontEndReset]);
    });
}

#[test]
fn a_chip_whose_every_frame_is_damaged_is_given_up_on() {
    setup(|mut on| {
        on.sampler.bus_mut().on_the_way_in = Box::new(|bytes| bytes[4] ^= 1);
        on.run(1000);
        assert_eq!(on.numbers(), []);
        assert!(matches!(on.events()[..], [EventKind::FrontEndMissing { .. }]));
        assert_eq!(on.main.tally().damaged, u32::from(GONE_AFTER_DAMAGED));
    });
}

#[test]
fn without_a_front_end_requests_are_refused_at_once() {
    setup(|mut on| {
        on.front_end.borrow_mut().set_faults(Faults { chip_absent: Some(FloatingBus::High), ..Faults::default() });
        on.sampler.restore_settings(DeviceTime(0));
        let kinds = [RequestKind::SelfTest, RequestKind::Stream(true), RequestKind::ReadRegister(0)];
        for (kind, ticket) in kinds.into_iter().zip(0..) {
            assert!(on.main.request(FrontEndRequest { ticket, kind }));
            on.sampler.idle(DeviceTime(1000));
            assert_eq!(on.findings(), [Finding::Refused(Refusal::NoFrontEnd)], "{kind:?}");
        }
    });
}

#[test]
fn a_silence_of_two_hours_is_counted_although_the_clock_wraps() {
    setup(|mut on| {
        on.run(10);
        // The clock wraps after 71.6 minutes.
        for _ in 0..7200 {
            on.time = on.time.wrapping_add(1_000_000);
            on.sampler.idle(DeviceTime(on.time));
        }
        on.run(10);
        assert_eq!(on.main.tally().samples, 10 + 7200 * 4000 + 10);
        assert_eq!(on.main.tally().missed, 7200 * 4000);
    });
}

//! What only a board can do: its last fault, its health, restarting, failing on purpose.

mod rig;

use palpate_firmware_core::device::Order;
use palpate_shared::sim::FingerConfig;
use palpate_shared::wire::{Failure, Fault, FaultCause, Health, Outcome, Refusal, Request};
use rig::{Bench, Rig, World};

const FAIL: Request = Request::Fail { failure: Failure::StackOverflow };

const REQUESTS: [Request; 5] = [Request::LastFault, Request::Health, Request::Reboot, Request::EnterLoader, FAIL];

fn fault() -> Fault {
    Fault {
        cause: FaultCause::Processor,
        uptime_s: 3,
        samples: 12_000,
        program_counter: 0x0800_0400,
        return_address: 0x0800_0200,
        fault_status: 0x8200,
        place: heapless::String::new(),
    }
}

#[test]
fn a_device_without_a_board_refuses_what_only_a_board_can_do() {
    let mut world = World::new(FingerConfig::default(), 1);
    let mut rig = Rig::new(&mut world, Bench::default());
    for request in REQUESTS {
        assert_eq!(rig.ask(request), Outcome::Refused(Refusal::NotOnThisBoard), "{request:?}");
    }
    assert_eq!(rig.device.take_order(), None);
}

#[test]
fn a_board_tells_of_its_last_fault_and_its_health() {
    let mut world = World::new(FingerConfig::default(), 1);
    let mut rig = Rig::new(&mut world, Bench::default());
    rig.device.accept_orders(Some(fault()));
    assert_eq!(rig.ask(Request::LastFault), Outcome::LastFault(Some(fault())));
    for stack_used_max in [0, 100, 3000] {
        let health = Health { stack_bytes: 8192, stack_used_max, ..Health::default() };
        rig.device.report_health(health);
        assert_eq!(rig.ask(Request::Health), Outcome::Health(health));
    }
}

#[test]
fn an_order_is_answered_before_it_is_given_and_given_once() {
    let mut world = World::new(FingerConfig::default(), 1);
    let mut rig = Rig::new(&mut world, Bench::default());
    rig.device.accept_orders(None);
    assert_eq!(rig.ask(Request::LastFault), Outcome::LastFault(None));
    let orders = [
        (Request::Reboot, Order::Reboot),
        (Request::EnterLoader, Order::EnterLoader),
        (FAIL, Order::Fail(Failure::StackOverflow)),
    ];
    for (request, order) in orders {
        let id = rig.send(request);
        // The command again, as when its reply was lost.
        rig.send_as(id, request);
        rig.run_us(2000);
        assert_eq!(rig.outcomes(id), [Outcome::Done, Outcome::Done]);
        assert_eq!((rig.device.take_order(), rig.device.take_order()), (Some(order), None));
    }
}

#[test]
fn a_device_that_can_only_restart_takes_no_other_order() {
    let mut world = World::new(FingerConfig::default(), 1);
    let mut rig = Rig::new(&mut world, Bench::default());
    rig.device.accept_restarts();
    for (request, order) in [(Request::Reboot, Order::Reboot), (Request::EnterLoader, Order::EnterLoader)] {
        assert_eq!(rig.ask(request), Outcome::Done);
        assert_eq!(rig.device.take_order(), Some(order));
    }
    for request in [Request::LastFault, Request::Health, FAIL] {
        assert_eq!(rig.ask(request), Outcome::Refused(Refusal::NotOnThisBoard), "{request:?}");
    }
    assert_eq!(rig.device.take_order(), None);
}

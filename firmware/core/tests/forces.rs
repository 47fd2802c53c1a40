//! Forces that the device computes: the same bits as a host's, beside the raw counts, and at no sample's cost.

mod rig;

use palpate_firmware_core::store::NotStored;
use palpate_shared::force::ForceMatrix;
use palpate_shared::sim::{ContactLoad, FingerConfig, Load};
use palpate_shared::wire::{FromDevice, MeanForce, Outcome, Refusal, Request};
use rig::{Bench, Rig, World};

/// 37.45 µN a count, some cross-talk, and a tare.
fn matrix() -> ForceMatrix {
    ForceMatrix::new([[-37.45e-6, 1.2e-6], [0.4e-6, -36.9e-6]], [1234.5, -250.25]).expect("it fits")
}

fn set(matrix: ForceMatrix) -> Request {
    Request::SetForceMatrix { matrix, checksum: matrix.checksum() }
}

fn forces(rig: &Rig<'_>) -> Vec<MeanForce> {
    let heard = rig.heard.messages.iter();
    heard.filter_map(|message| if let FromDevice::Force(force) = message { Some(*force) } else { None }).collect()
}

/// Runs a test on a device that is up.
fn started(bench: Bench, test: impl FnOnce(&mut Rig<'_>)) {
    let mut world = World::new(FingerConfig::default(), 1);
    let mut rig = Rig::new(&mut world, bench);
    rig.run_us(5000);
    test(&mut rig);
}

#[test]
fn each_block_is_followed_by_its_force_bit_for_bit() {
    started(Bench::default(), |rig| {
        rig.front_end().borrow_mut().set_load(Load::Static(ContactLoad::frictionless(0.7, 2.0)));
        assert_eq!(rig.ask(set(matrix())), Outcome::Done);
        assert_eq!(rig.ask(Request::ForceMatrix), Outcome::ForceMatrix(Some(matrix())));
        assert_eq!(rig.ask(Request::StreamForces { on: true }), Outcome::Done);
        assert_eq!(rig.ask(Request::Start), Outcome::Done);
        rig.run(8000);
        assert_eq!(rig.ask(Request::Stop), Outcome::Done);
        let mut messages = rig.heard.messages.iter().skip_while(|message| !matches!(message, FromDevice::Block(_)));
        let mut pairs = 0;
        while let Some(message) = messages.next() {
            let FromDevice::Block(block) = message else { continue };
            let Some(FromDevice::Force(force)) = messages.next() else { panic!("no force after {block:?}") };
            assert_eq!((force.first, force.time, force.status), (block.first, block.time, block.status));
            assert_eq!(usize::from(force.samples), block.samples.len());
            assert_eq!(Some(force.force_un), matrix().force_un(block.samples.iter().copied()));
            pairs += 1;
        }
        assert!(pairs >= 1000, "{pairs} blocks");
        assert_eq!((rig.heard.gaps(), rig.wrong_samples()), (0, 0));
    });
}

#[test]
fn a_tare_holds_from_the_next_block_on_while_streaming() {
    started(Bench::default(), |rig| {
        assert_eq!(rig.ask(set(matrix())), Outcome::Done);
        assert_eq!(rig.ask(Request::StreamForces { on: true }), Outcome::Done);
        rig.start_streaming();
        rig.run(400);
        let tared = matrix().tared([50.0, 60.0]).expect("it fits");
        assert_eq!(rig.ask(Request::SetForceTare { tare: tared.tare }), Outcome::Done);
        rig.run(400);
        let last = *forces(rig).last().expect("forces came");
        let block = rig.heard.blocks().find(|block| block.first == last.first).expect("its block").clone();
        assert_eq!(Some(last.force_un), tared.force_un(block.samples.iter().copied()));
        assert_eq!(rig.ask(Request::StreamForces { on: false }), Outcome::Done);
        let told = forces(rig).len();
        rig.run(400);
        assert_eq!(forces(rig).len(), told);
    });
}

#[test]
fn what_is_damaged_or_comes_at_the_wrong_time_is_refused() {
    started(Bench::default(), |rig| {
        let refused = |refusal| Outcome::Refused(refusal);
        assert_eq!(rig.ask(Request::ForceMatrix), Outcome::ForceMatrix(None));
        assert_eq!(rig.ask(Request::StreamForces { on: true }), refused(Refusal::NoForceMatrix));
        assert_eq!(rig.ask(Request::SetForceTare { tare: [0; 2] }), refused(Refusal::NoForceMatrix));
        let damaged = Request::SetForceMatrix { matrix: matrix(), checksum: matrix().checksum() ^ 1 };
        assert_eq!(rig.ask(damaged), refused(Refusal::MatrixDamaged));
        let unsound = ForceMatrix { entries: [[i32::MIN, 0], [0, 1]], ..matrix() };
        assert_eq!(rig.ask(set(unsound)), refused(Refusal::MatrixDamaged));
        assert_eq!(rig.ask(set(matrix())), Outcome::Done);
        assert_eq!(rig.ask(Request::SetForceTare { tare: [i32::MAX, 0] }), refused(Refusal::MatrixDamaged));
        rig.start_streaming();
        assert_eq!(rig.ask(set(matrix())), refused(Refusal::Streaming));
        assert_eq!(rig.ask(Request::ForceMatrix), Outcome::ForceMatrix(Some(matrix())));
    });
}

#[test]
fn a_line_that_does_not_carry_them_refuses_forces_and_rates() {
    started(Bench::default(), |rig| {
        assert_eq!(rig.ask(set(matrix())), Outcome::Done);
        assert_eq!(rig.ask(Request::SetRate { rate_hz: 8000 }), Outcome::Done);
        let too_slow = Outcome::Refused(Refusal::LinkTooSlow { fastest_hz: 4000 });
        assert_eq!(rig.ask(Request::StreamForces { on: true }), too_slow);
        assert_eq!(rig.ask(Request::SetRate { rate_hz: 4000 }), Outcome::Done);
        assert_eq!(rig.ask(Request::StreamForces { on: true }), Outcome::Done);
        assert_eq!(rig.ask(Request::SetRate { rate_hz: 8000 }), too_slow);
    });
}

#[test]
fn a_matrix_is_stored_at_rest_by_a_board_that_can_and_answered_once_it_is() {
    started(Bench::default(), |rig| {
        let refused = |refusal| Outcome::Refused(refusal);
        let (store, forget) = (Request::StoreForceMatrix { keep: true }, Request::StoreForceMatrix { keep: false });
        assert_eq!(rig.ask(store), refused(Refusal::NotOnThisBoard));
        rig.device.accept_store(None);
        assert_eq!(rig.ask(store), refused(Refusal::NoForceMatrix));
        assert_eq!(rig.ask(set(matrix())), Outcome::Done);
        let id = rig.send(store);
        // The host loses patience: it is not stored twice. Nothing starts meanwhile, since the chip may stand still.
        rig.send_as(id, store);
        let (start, other) = (rig.send(Request::Start), rig.send(forget));
        rig.run(20);
        assert_eq!(rig.outcomes(id), []);
        assert_eq!([start, other].map(|id| rig.outcomes(id)), [[refused(Refusal::Busy)], [refused(Refusal::Busy)]]);
        assert_eq!(rig.device.take_store(), Some(Some(matrix())));
        rig.device.stored(Ok(300));
        rig.run(20);
        assert_eq!(rig.outcomes(id), [Outcome::Stored { stalled_us: 300 }]);
        rig.send_as(id, store);
        rig.run(20);
        assert_eq!(rig.outcomes(id).len(), 2);
        assert_eq!(rig.device.take_store(), None);
        // A flash that does not take it; and none any more.
        for (request, matrix, result, outcome) in [
            (store, Some(matrix()), Err(NotStored), refused(Refusal::NotStored)),
            (forget, None, Ok(0), Outcome::Stored { stalled_us: 0 }),
        ] {
            let id = rig.send(request);
            assert_eq!(rig.device.take_store(), Some(matrix));
            rig.device.stored(result);
            rig.run(20);
            assert_eq!(rig.outcomes(id), [outcome]);
        }
        rig.start_streaming();
        for request in [store, forget] {
            assert_eq!(rig.ask(request), refused(Refusal::Streaming));
        }
        assert_eq!((rig.device.take_store(), rig.heard.gaps()), (None, 0));
    });
}

#[test]
fn what_a_board_found_in_its_flash_is_the_matrix_until_a_host_gives_another() {
    started(Bench::default(), |rig| {
        rig.device.accept_store(Some(matrix()));
        assert_eq!(rig.ask(Request::ForceMatrix), Outcome::ForceMatrix(Some(matrix())));
        assert_eq!(rig.ask(Request::StreamForces { on: true }), Outcome::Done);
        rig.start_streaming();
        rig.run(400);
        assert!(!forces(rig).is_empty());
    });
}

//! Samples from the chip model through the firmware to a host.

mod rig;

use palpate_shared::sim::FingerConfig;
use palpate_shared::wire::{Outcome, Request, Status};
use rig::{Bench, Rig, World};

#[test]
fn a_second_of_samples_arrives_whole_and_in_order() {
    let mut world = World::new(FingerConfig::default(), 1);
    let mut rig = Rig::new(&mut world, Bench::default());
    rig.start_streaming();
    rig.run(4000);
    assert_eq!(rig.ask(Request::Stop), Outcome::Done);
    let numbers: Vec<u32> = rig.heard.samples().map(|sample| sample.seq.0).collect();
    assert!(numbers.len() >= 4000, "{}", numbers.len());
    assert!(numbers.iter().zip(0..).all(|(&got, wanted)| got == wanted));
    assert!(rig.heard.blocks().all(|block| block.status == Status::default()));
    assert_eq!(rig.device.counters().samples as usize, numbers.len());
}

//! Digital inputs, read with the samples and told as they change.

mod rig;

use palpate_shared::sim::FingerConfig;
use palpate_shared::units::DeviceTime;
use palpate_shared::wire::{EventKind, FromDevice, Inputs, Outcome, Request, Source};
use rig::{Bench, Rig, World};

fn told(rig: &Rig<'_>) -> Vec<Inputs> {
    let heard = rig.heard.messages.iter();
    heard.filter_map(|message| if let FromDevice::Inputs(inputs) = message { Some(*inputs) } else { None }).collect()
}

fn set(rig: &mut Rig<'_>, levels: u8) {
    rig.front_end().borrow_mut().set_inputs(levels);
}

#[test]
fn levels_come_at_the_start_and_with_the_sample_that_saw_them_change() {
    let mut world = World::new(FingerConfig::ideal(), 1);
    let mut rig = Rig::new(&mut world, Bench::default());
    set(&mut rig, 0xF0);
    rig.run_us(50_000);
    assert_eq!(told(&rig), [], "nothing before the stream");
    assert_eq!(rig.ask(Request::Start), Outcome::Done);
    rig.run(40);
    let before = rig.now();
    set(&mut rig, 0xF1);
    rig.run(40);
    set(&mut rig, 0x00);
    rig.run(40);
    let all = told(&rig);
    assert_eq!(all.iter().map(|one| (one.levels, one.changes)).collect::<Vec<_>>(), [(0xF0, 0), (0xF1, 1), (0, 5)]);
    assert_eq!([all[1].time, all[2].time], [250, 41 * 250].map(|us| DeviceTime(before.0 + us)));
    assert_eq!((rig.heard.gaps(), rig.wrong_samples()), (0, 0));
}

#[test]
fn an_input_that_flutters_costs_no_sample_on_a_line_that_is_full() {
    let mut world = World::new(FingerConfig::ideal(), 1);
    let mut rig = Rig::new(&mut world, Bench::default());
    rig.start_streaming();
    for n in 0..8000_u32 {
        set(&mut rig, u8::from(n % 2 == 0));
        rig.step();
    }
    rig.run(100);
    let all = told(&rig);
    assert!((400..=420).contains(&all.len()), "{} messages in 2 s", all.len());
    // 8000 samples saw as many changes, the first of them against the level at the start.
    let changes = all.iter().map(|one| u32::from(one.changes)).sum::<u32>();
    assert!((7999..=8000).contains(&changes), "{changes}");
    assert_eq!(rig.heard.losses(), [0; 3]);
    assert_eq!((rig.heard.gaps(), rig.wrong_samples()), (0, 0));
}

#[test]
fn a_simulated_source_has_inputs_of_its_own() {
    let mut world = World::new(FingerConfig::ideal(), 1);
    let mut rig = Rig::new(&mut world, Bench::default());
    set(&mut rig, 0xAA);
    rig.run_us(5000);
    assert_eq!(rig.ask(Request::SetSource { source: Source::Simulated }), Outcome::Done);
    set(&mut rig, 0x55);
    assert_eq!(rig.ask(Request::Start), Outcome::Done);
    rig.run(10);
    assert_eq!(told(&rig).iter().map(|one| one.levels).collect::<Vec<_>>(), [0x55]);
    assert!(!rig.heard.faults().iter().any(|kind| matches!(kind, EventKind::FrontEndMissing { .. })));
}

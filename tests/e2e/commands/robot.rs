//! The robot that carries the finger: what stops it and how soon, and the program in docs/ROBOT.md that speaks its lines.

use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use nalgebra::Point2;
use palpate::finger::calibration::Calibration;
use palpate::finger::contact::ContactSettings;
use palpate::finger::force_guard::ForceStop;
use palpate::finger::judge::CountsJudge;
use palpate::finger::sense::FingerSense;
use palpate::geometry::{Pose, SimplePolygon};
use palpate::pushing::approach_speed::ApproachLimits;
use palpate::pushing::quasi_static::Support;
use palpate::pushing::touched_world::{TouchErrors, TouchedWorld};
use palpate_cli::live;
use palpate_cli::live::guided::{GuidedError, GuidedFinger, Went};
use palpate_cli::live::listening::{ListenError, ListeningFinger};
use palpate_cli::thesis::demonstration::{Rig, compliance_by_design};
use palpate_device::Address;
use palpate_device::robot::protocol::RobotOrder;
use palpate_device::robot::{RobotError, RobotLink};
use palpate_device::session::SessionOptions;
use palpate_device::simulated::robot::{RobotConfig, SimulatedRobot};
use palpate_device::simulated::{Config, Line, LineFaults, LinkFaults, Pace, SimulatedDevice};
use palpate_device::{LinkError, Session};
use palpate_shared::sim::Faults;
use palpate_tests::rig::{peer_that_says, robot_that_tells};

/// Of the simulated finger: all of these tests use one.
const SEED: u64 = 31;

/// Samples of a block take so long at 4 kHz, s.
const BLOCK_S: f64 = 2e-3;

/// A conversion until it is read, a step of the world until an order is due and one until it acts; and what the
/// converter's filter delays, s.
const ROUNDING_S: f64 = 3.0 * 250e-6 + 375e-6;

fn calibration() -> Calibration {
    static CALIBRATION: OnceLock<Calibration> = OnceLock::new();
    let found = CALIBRATION.get_or_init(|| Rig::start(SEED, 1.0, Line::Pipe).unwrap().fit().calibration.clone());
    found.clone()
}

/// A block of 50 mm whose nearest side is at x = 50 mm, too heavy to be moved.
fn world() -> TouchedWorld {
    let outline = [[0.0, -0.025], [0.05, -0.025], [0.05, 0.025], [0.0, 0.025]].map(Point2::from);
    TouchedWorld {
        outline: SimplePolygon::new(outline).unwrap(),
        support: Support::Uniform { friction: 0.3 },
        mass: 50.0,
        gravity: 9.81,
        radius: 0.015,
        contact_friction: 0.25,
        limits: ApproachLimits {
            stiffness: 1.0 / compliance_by_design(),
            threshold: 0.0,
            latency: 0.0,
            deceleration: f64::INFINITY,
        },
        errors: TouchErrors { position: 0.0, clock: 0.0, angle: 0.0 },
        pose: Pose { x: 0.05, y: 0.0, theta: 0.0 },
        pressed: None,
    }
}

/// A finger on a robot in one world, whose hand can break things.
struct Carried {
    robot: SimulatedRobot,
    device: Arc<SimulatedDevice>,
    finger: GuidedFinger,
}

fn carried(config: RobotConfig, touch_force: f64, force_limit: f64) -> Carried {
    let robot = SimulatedRobot::new(config, world());
    let carried_by = Some(robot.clone());
    let config = Config { seed: SEED, pace: Pace::AsAsked, carried_by, ..Config::default() };
    let device = Arc::new(SimulatedDevice::start(config).unwrap());
    let mut session = Session::open_simulated(Arc::clone(&device), SessionOptions::default()).unwrap();
    let link = RobotLink::simulated(robot.clone(), session.epoch());
    live::start(&mut session).unwrap();
    let settings = ContactSettings::default();
    let mut judge = CountsJudge::new(&calibration());
    let tare = live::tare(&mut session, &mut judge, 0.5, &settings, None, |_| ()).unwrap();
    let sense = FingerSense::new(Some(calibration()), tare, &settings).unwrap();
    let finger = ListeningFinger::new(session, judge, sense, touch_force, force_limit);
    Carried { robot, device, finger: GuidedFinger::new(finger, link, 2e-5) }
}

/// With which the finger runs into the block, m/s.
const SPEED: f64 = 0.02;

/// Above which the robot is to stop, N.
const LIMIT_N: f64 = 3.0;

#[test]
fn above_the_force_limit_the_robot_is_told_to_stop_within_a_block_and_its_latency() {
    let (mut worst, mut latest) = (0.0_f64, 0.0_f64);
    // Begun at other places the force rises at other moments of a block.
    for start_um in [0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0] {
        let config = RobotConfig { start: Point2::new(0.03 + start_um * 1e-6, 0.0), ..RobotConfig::default() };
        let latency = config.latency;
        let mut it = carried(config, 100.0, LIMIT_N);
        let gone = it.finger.go(Point2::new(0.06, 0.0), SPEED, false);
        let Err(GuidedError::Finger(ListenError::Force(ForceStop::Above { t, force, .. }))) = gone else {
            panic!("{gone:?}");
        };
        let told = it.robot.truth();
        it.robot.go_on_to(told.t + 0.2);
        let stands = it.robot.truth();
        let took = stands.stopped.unwrap() - t;
        assert!(force > LIMIT_N && took <= BLOCK_S + latency + ROUNDING_S, "{took} s, at {force} N");
        // v τ + v²/2a, and half of the time over which acceleration rises, on the beam's stiffness.
        let braking = 0.5 * SPEED / config.acceleration + 0.5 * config.acceleration / config.jerk;
        let way = SPEED * (BLOCK_S + latency + ROUNDING_S + braking);
        assert!(
            stands.velocity.norm() < 1e-9 && stands.force_max < LIMIT_N + way / compliance_by_design(),
            "{stands:?}"
        );
        (worst, latest) = (worst.max(took), latest.max(stands.force_max));
    }
    println!(
        "from the reading above the limit to the stop acting: at most {:.2} ms, of which the robot's latency is 4 ms; \
         at most {latest:.2} N with a limit of 3 N at 20 mm/s",
        worst * 1e3
    );
}

#[test]
fn samples_that_are_lost_or_measure_nothing_stop_the_robot() {
    let lost = LinkFaults { line: LineFaults { drop: 0.02, ..LineFaults::default() }, ..LinkFaults::default() };
    type Break<'b> = (&'b str, &'b dyn Fn(&SimulatedDevice));
    let breaks: [Break<'_>; 2] = [
        ("lost", &|device| _ = device.set_link_faults(lost).unwrap()),
        ("saturated", &|device| {
            _ = device.set_faults(Faults { saturated: [true, false], ..Faults::default() }).unwrap()
        }),
    ];
    for (what, break_it) in breaks {
        let mut it = carried(RobotConfig { start: Point2::origin(), ..RobotConfig::default() }, 0.1, 3.0);
        assert_eq!(it.finger.go(Point2::new(0.0, 0.005), 0.05, true).unwrap(), Went::There);
        break_it(&it.device);
        // A line that loses frames may lose none for a while; one whose converter is overloaded never begins.
        let gone = it.finger.go(Point2::new(0.0, 1.0), 0.05, true);
        let Err(GuidedError::Finger(error)) = gone else { panic!("{what}: {gone:?}") };
        let is_right = match &error {
            ListenError::Force(ForceStop::Lost) => what == "lost",
            ListenError::Force(ForceStop::NotMeasured(_)) | ListenError::NoSamples(_) => what == "saturated",
            _ => false,
        };
        assert!(is_right, "{what}: {error}");
        let told = it.robot.truth();
        it.robot.go_on_to(told.t + 0.5);
        assert!(it.robot.truth().velocity.norm() < 1e-9, "{what}: it goes on");
    }
}

#[test]
fn a_robot_that_is_lost_under_way_ends_it() {
    let mut it = carried(RobotConfig::default(), 0.1, 3.0);
    let address = Address::Tcp(peer_that_says(b"0.1 0 0\n".to_vec()).to_string());
    let link = RobotLink::open(&address, Instant::now()).unwrap();
    it.finger = GuidedFinger::new(it.finger.into_finger(), link, 2e-5);
    let gone = it.finger.go(Point2::new(0.06, 0.0), SPEED, true);
    assert!(matches!(gone, Err(GuidedError::Robot(RobotError::Silent { .. }))), "{gone:?}");
}

#[test]
fn a_finger_that_goes_to_a_part_stops_and_tells_where_and_how_it_presses() {
    let mut it = carried(RobotConfig { start: Point2::new(0.02, 0.0), ..RobotConfig::default() }, 0.1, 5.0);
    let Went::Touched(stand) = it.finger.go(Point2::new(0.06, 0.0), 0.005, true).unwrap() else { panic!("missed") };
    let tip = stand.place + stand.force * compliance_by_design();
    // The side is at 50 mm, the disk's centre 15 mm before it. The places' mean has 5 µm, the compliance's share a few.
    assert!((tip - Point2::new(0.035, 0.0)).norm() < 2e-5, "{tip}");
    assert!(stand.force.x < -0.1 && stand.force.y.abs() < 0.05 * stand.force.x.abs(), "{}", stand.force);
    assert_eq!(it.finger.go(Point2::new(0.02, 0.0), 0.05, false).unwrap(), Went::There);
}

/// What is due is due by the robot's clock.
#[test]
fn a_robot_whose_clock_does_not_go_on_by_seconds_is_told() {
    let told = |line: fn(f64) -> String, until_s: f64| {
        let mut link = RobotLink::open(&Address::Tcp(robot_that_tells(line).to_string()), Instant::now()).unwrap();
        let begun = Instant::now();
        while begun.elapsed().as_secs_f64() < until_s {
            if let Err(error) = link.places() {
                return Some(error);
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        None
    };
    // A clock of its own may begin anywhere, and run a little fast.
    let well = told(|s| format!("{} 0 0", 1.05 * s + 7.0), 3.0);
    assert!(well.is_none(), "{well:?}");
    let wrong: [fn(f64) -> String; 3] =
        [|_| "1.0 0 0".to_owned(), |s| format!("{} 0 0", 1e3 * s), |s| format!("{} 0 0", 9.0 - s)];
    for line in wrong {
        // Far longer than a look at the clock takes.
        let error = told(line, 60.0).unwrap();
        assert!(matches!(error, RobotError::Clock { .. }) && error.to_string().contains("went on by"), "{error}");
    }
}

#[test]
fn a_robot_that_falls_silent_hangs_up_or_says_something_else_is_told_apart() {
    // What goes wrong may be found while the first place is waited for.
    let error = |said: &[u8]| {
        let address = Address::Tcp(peer_that_says(said.to_vec()).to_string());
        match RobotLink::open(&address, Instant::now()) {
            Err(error) => error,
            Ok(mut link) => loop {
                if let Err(error) = link.places() {
                    break error;
                }
            },
        }
    };
    let silent = error(b"0.1 0 0\n");
    assert!(matches!(silent, RobotError::Silent { .. }) && silent.to_string().contains("told no place"), "{silent}");
    assert!(matches!(error(b""), RobotError::Silent { .. }));
    let refuses = error(b"0.1 0 0\nerror the arm is off\n");
    assert!(refuses.to_string().contains("the arm is off"), "{refuses}");
    let other = error(b"0.1 0 0\nHTTP/1.1 400 Bad Request\n");
    assert!(matches!(other, RobotError::NotARobot(_)) && other.to_string().contains("HTTP/1.1"), "{other}");
    // Of what came before any place the line is told, whether or not it ended.
    for (said, word) in
        [(&b"hello\nworld\n"[..], "`world`"), (b"0.1 nan 0\n", "`0.1 nan 0`"), (b"0.1 0 0", "no line feed")]
    {
        let other = error(said);
        assert!(matches!(other, RobotError::NotARobot(_)) && other.to_string().contains(word), "{other}");
    }
    let refuses = error(b"0.1 0 0\nerror \x1b[31mred\n");
    assert!(!refuses.to_string().contains('\x1b'), "{refuses}");
    let nobody = RobotLink::open(&Address::Tcp("127.0.0.1:1".to_owned()), Instant::now());
    assert!(matches!(nobody, Err(RobotError::Link(LinkError::Open { .. }))));
}

/// The first program in docs/ROBOT.md after a heading.
fn program(heading: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/ROBOT.md");
    let page = std::fs::read_to_string(path).unwrap();
    let after = page.split_once(heading).unwrap().1.split_once("```python\n").unwrap().1;
    after.split_once("```").unwrap().0.to_owned()
}

/// Python, or said that there is none.
fn python(arguments: &[&str]) -> Option<Command> {
    let there = Command::new("python3").arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status();
    if !there.is_ok_and(|status| status.success()) {
        eprintln!("not run: there is no python3");
        return None;
    }
    let mut command = Command::new("python3");
    command.args(arguments).stdin(Stdio::null());
    Some(command)
}

#[test]
fn the_documented_robot_in_python_goes_where_it_is_told_and_stops() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("robot.py");
    std::fs::write(&file, program("## A robot in ten lines")).unwrap();
    // A port that was free a moment ago.
    let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let Some(mut command) = python(&[file.to_str().unwrap(), &port.to_string()]) else { return };
    let mut child = command.spawn().unwrap();
    let address = Address::Tcp(format!("127.0.0.1:{port}"));
    let begun = Instant::now();
    let mut link = loop {
        match RobotLink::open(&address, Instant::now()) {
            Ok(link) => break link,
            // Until it listens.
            Err(RobotError::Link(_)) if begun.elapsed() < palpate_tests::rig::PATIENCE => {
                assert!(child.try_wait().unwrap().is_none(), "it ended");
            }
            Err(error) => panic!("{error}"),
        }
    };
    let to = Point2::new(0.01, -0.02);
    link.order(RobotOrder::Move { to, speed: 0.2 }).unwrap();
    while (link.place().unwrap().at - to).norm() > 1e-6 {}
    link.order(RobotOrder::Move { to: Point2::origin(), speed: 1e-3 }).unwrap();
    while (link.place().unwrap().at - to).norm() < 1e-4 {}
    link.order(RobotOrder::Stop).unwrap();
    // It stands when two places some time apart are one.
    let mut last = link.place().unwrap();
    loop {
        let next = link.place().unwrap();
        if next.t - last.t > 0.05 {
            if next.at == last.at {
                break;
            }
            last = next;
        }
    }
    assert!(last.at.coords.norm() > 0.02, "it went on to the end: {}", last.at);
    drop(link);
    assert!(child.wait().unwrap().success(), "it ends with its line");
}

#[test]
fn the_adapter_for_a_real_controller_is_python() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("adapter.py");
    std::fs::write(&file, program("## An adapter for Universal Robots")).unwrap();
    let Some(mut command) = python(&["-m", "py_compile", file.to_str().unwrap()]) else { return };
    assert!(command.status().unwrap().success());
}

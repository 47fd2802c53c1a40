//! The simulated robot keeps its limits, and is a robot to the link.

use palpate::geometry::SimplePolygon;
use palpate::pushing::approach_speed::ApproachLimits;
use palpate::pushing::quasi_static::Support;
use palpate::pushing::touched_world::TouchErrors;

use super::*;
use crate::robot::RobotLink;

/// A square of 40 mm about (100, 0) mm.
fn world() -> TouchedWorld {
    let outline = [[0.08, -0.02], [0.12, -0.02], [0.12, 0.02], [0.08, 0.02]].map(Point2::from);
    TouchedWorld {
        outline: SimplePolygon::new(outline).unwrap(),
        support: Support::Uniform { friction: 0.3 },
        mass: 1.0,
        gravity: 9.81,
        radius: 0.015,
        contact_friction: 0.25,
        limits: ApproachLimits { stiffness: 27e3, threshold: 0.1, latency: 0.01, deceleration: 2.0 },
        errors: TouchErrors { position: 0.0, clock: 0.0, angle: 0.0 },
        pose: Pose { x: 0.0, y: 0.0, theta: 0.0 },
        pressed: None,
    }
}

/// Differences of places in steps of the simulation round to this share of a limit.
const ROUNDING: f64 = 1e-3;

#[test]
fn it_goes_where_it_is_told_within_its_speed_acceleration_and_jerk() {
    let config = RobotConfig { position_sd: 0.0, ..RobotConfig::default() };
    let mut drive = Drive::new(&config);
    let mut places = vec![drive.place(); 3];
    let targets = [(Point2::new(0.03, 0.04), 0.1), (Point2::new(0.03, 0.041), 0.5), (Point2::origin(), 0.02)];
    for (to, speed) in targets {
        drive.order(RobotOrder::Move { to, speed });
        for _ in 0..16_000 {
            drive.step();
            places.push(drive.place());
            assert!(drive.velocity().norm() <= speed * (1.0 + ROUNDING));
        }
        assert!((drive.place() - to).norm() < 1e-8, "{} is not {to}", drive.place());
    }
    let derivative = |of: &[Vector2<f64>]| -> Vec<_> { of.windows(2).map(|two| (two[1] - two[0]) / STEP_S).collect() };
    let velocities = derivative(&places.iter().map(|place| place.coords).collect::<Vec<_>>());
    let accelerations = derivative(&velocities);
    let largest = |of: &[Vector2<f64>]| of.iter().map(Vector2::norm).fold(0.0, f64::max);
    assert!(largest(&accelerations) <= config.acceleration * (1.0 + ROUNDING), "{}", largest(&accelerations));
    // From speeding up straight to braking acceleration changes by twice its limit.
    let jerk = largest(&derivative(&accelerations));
    assert!(jerk <= 2.0 * config.jerk * (1.0 + ROUNDING), "{jerk}");
}

#[test]
fn a_stop_acts_after_the_latency_and_takes_the_way_that_braking_takes() {
    let config = RobotConfig::default();
    let robot = SimulatedRobot::new(config, world());
    robot.order(RobotOrder::Move { to: Point2::new(0.0, 0.2), speed: 0.1 });
    robot.go_on_to(0.5);
    let ordered = robot.truth();
    assert!((ordered.velocity.y - 0.1).abs() < 1e-9);
    robot.order(RobotOrder::Stop);
    robot.go_on_to(1.0);
    let stands = robot.truth();
    let acted = stands.stopped.unwrap() - ordered.t;
    assert!((acted - config.latency).abs() <= 1.5 * STEP_S, "{acted}");
    // v τ + v²/2a, and half of the time over which the mean is taken.
    let way = 0.1 * (config.latency + 0.5 * 0.1 / config.acceleration + 0.5 * config.acceleration / config.jerk);
    let went = stands.clamp.y - ordered.clamp.y;
    assert!((went - way).abs() < 0.1 * 3.0 * STEP_S && stands.velocity.norm() < 1e-9, "{went} for {way}");
}

#[test]
fn places_are_told_late_with_the_robots_own_clock_and_its_errors() {
    let config = RobotConfig { latency: 0.05, ..RobotConfig::default() };
    let robot = SimulatedRobot::new(config, world());
    robot.go_on_to(20.0);
    let told = robot.told();
    let last = told.last().unwrap();
    let world_time = robot.world_time(last.t);
    assert!((20.0 - config.latency - config.report_period..=20.0 - config.latency + STEP_S).contains(&world_time));
    assert!((last.t - 812.5 - world_time * (1.0 + 2e-5)).abs() < 1e-9);
    let count = told.len() as f64;
    let variance = told.iter().map(|place| place.at.coords.norm_squared()).sum::<f64>() / (2.0 * count);
    // Of 4096 places with two coordinates each the variance is known to 1.6 %.
    assert!((variance.sqrt() / config.position_sd - 1.0).abs() < 0.05, "{}", variance.sqrt());
}

#[test]
fn a_link_moves_it_over_tcp_and_a_wrong_order_is_answered() {
    let robot = SimulatedRobot::new(RobotConfig::default(), world());
    let server = robot.serve(&Line::Tcp { host: "127.0.0.1:0".to_owned() }, true).unwrap();
    let mut link = RobotLink::open(server.address(), Instant::now()).unwrap();
    let to = Point2::new(0.0, 0.01);
    link.order(RobotOrder::Move { to, speed: 0.1 }).unwrap();
    while (link.place().unwrap().at - to).norm() > 2e-4 {}
    assert!(link.clock().is_some());
    drop((link, server));
    let server = robot.serve(&Line::Tcp { host: "127.0.0.1:0".to_owned() }, true).unwrap();
    let Address::Tcp(host) = server.address() else { panic!("not over TCP") };
    let stream = std::net::TcpStream::connect(host).unwrap();
    std::io::Write::write_all(&mut &stream, b"move 1 2\n").unwrap();
    let mut lines = std::io::BufRead::lines(std::io::BufReader::new(stream)).map(Result::unwrap);
    let error = lines.find(|line| line.starts_with("error")).unwrap();
    assert!(error.contains("move 1 2") && error.contains("too few"), "{error}");
}

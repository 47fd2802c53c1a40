//! The examples run, each to the assertions at its end.

#[path = "../examples/calibrate.rs"]
mod calibrate;
#[path = "../examples/estimate_pose.rs"]
mod estimate_pose;
#[path = "../examples/fewest_points.rs"]
mod fewest_points;
#[path = "../examples/rolling_body.rs"]
mod rolling_body;
#[path = "../examples/simulate_push.rs"]
mod simulate_push;

use std::error::Error;

#[test]
fn calibrate_runs() -> Result<(), Box<dyn Error>> {
    calibrate::main()
}

#[test]
fn estimate_pose_runs() -> Result<(), Box<dyn Error>> {
    estimate_pose::main()
}

#[test]
fn fewest_points_runs() -> Result<(), Box<dyn Error>> {
    fewest_points::main()
}

#[test]
fn rolling_body_runs() -> Result<(), Box<dyn Error>> {
    rolling_body::main()
}

#[test]
fn simulate_push_runs() -> Result<(), Box<dyn Error>> {
    simulate_push::main()
}

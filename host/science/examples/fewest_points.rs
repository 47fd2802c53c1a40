//! The fewest points whose covered-or-free pattern tells places of a part apart, proven, and in the roomiest places.
//!
//! `cargo run --release --example fewest_points`

use std::error::Error;

use nalgebra::{Isometry2, Point2, Vector2};
use palpate::geometry::SimplePolygon;
use palpate::point_sampling::{Request, contains, plan};

pub(crate) fn main() -> Result<(), Box<dyn Error>> {
    let bracket = [[0.0, 0.0], [0.06, 0.0], [0.06, 0.02], [0.02, 0.02], [0.02, 0.05], [0.0, 0.05]].map(Point2::from);
    // Six places in which a feeder leaves the part: shift (m) and turn (°).
    let places = [
        (0.0, 0.0, 0.0),
        (0.01, 0.0, 0.0),
        (0.0, 0.01, 0.0),
        (0.06, 0.05, 180.0),
        (0.05, 0.0, 90.0),
        (0.0, 0.06, -90.0),
    ];
    let placed = |&(x, y, turn): &(f64, f64, f64)| {
        let pose = Isometry2::new(Vector2::new(x, y), f64::to_radians(turn));
        SimplePolygon::new(bracket.map(|corner| pose * corner))
    };
    let polygons = places.iter().map(placed).collect::<Result<Vec<_>, _>>()?;

    // The last argument is asked whether to stop: never, here.
    let plan = plan(&polygons, &Request::default(), &|| false);
    println!("{} points, and no fewer than {} could do:", plan.points.len(), plan.lower_bound);
    for circle in &plan.points {
        let point = circle.centre;
        let pattern: String =
            polygons.iter().map(|polygon| if contains(polygon, point) == Some(true) { '1' } else { '0' }).collect();
        println!("  ({:6.2}, {:6.2}) mm: covered in places {pattern}", point.x * 1e3, point.y * 1e3);
    }
    println!("each at least {:.2} mm from every outline", plan.clearance() * 1e3);

    assert_eq!(plan.points.len(), plan.lower_bound, "proven");
    assert!(plan.clearance() > 1e-3, "1 mm of room");
    Ok(())
}

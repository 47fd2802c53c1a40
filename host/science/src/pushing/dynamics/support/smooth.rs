//! Uniform pressure within a smooth closed curve, by quadrature along it.
//!
//! The curve is cut into panels with a Gauss rule each. The integrands of `uniform` have their only kink at the centre
//! of rotation, so panels are halved until they are far from it for their length, or too short to matter: their number
//! grows with the logarithm of the nearness, and the rules keep their full order.
//!
//! Frames: the part's axes, origin at the centroid. Units: SI. Errors: none; see [`DEPTH`] for what is left out.

use std::f64::consts::TAU;
use std::fmt;
use std::sync::Arc;

use nalgebra::{Point2, Vector2};

use super::uniform::Sums;

/// Panels to begin with.
const PANELS: u32 = 16;

/// Most halvings of a panel: what stays unresolved beside the centre of rotation is 1e-13 of the outline.
const DEPTH: u32 = 40;

/// Least distance of the centre of rotation from a panel's middle, in lengths of the panel.
///
/// It leaves the kink outside an ellipse around the panel on which 16 points err by less than 1e-16.
const CLEARANCE: f64 = 1.5;

/// Positive points and weights of the Gauss rule with 16 points, for an interval of length 2.
const NODES: [(f64, f64); 8] = [
    (0.095_012_509_837_637_44, 0.189_450_610_455_068_5),
    (0.281_603_550_779_258_9, 0.182_603_415_044_923_6),
    (0.458_016_777_657_227_4, 0.169_156_519_395_002_54),
    (0.617_876_244_402_643_8, 0.149_595_988_816_576_73),
    (0.755_404_408_355_003, 0.124_628_971_255_533_88),
    (0.865_631_202_387_831_8, 0.095_158_511_682_492_79),
    (0.944_575_023_073_232_6, 0.062_253_523_938_647_894),
    (0.989_400_934_991_649_9, 0.027_152_459_411_754_095),
];

/// Point and derivative by the parameter.
type Outline = dyn Fn(f64) -> (Point2<f64>, Vector2<f64>) + Send + Sync;

/// A smooth closed curve, with parameters from 0 to 1, counter-clockwise.
#[derive(Clone)]
pub(super) struct Smooth {
    outline: Arc<Outline>,
    /// The panels to begin with, most of which are far enough from every centre.
    panels: Arc<[Measured]>,
}

impl fmt::Debug for Smooth {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Smooth(..)")
    }
}

/// A stretch of the parameter.
#[derive(Clone, Copy)]
struct Panel {
    middle: f64,
    half: f64,
}

/// A point of the curve and `dp` for its share of a panel.
type Bit = (Vector2<f64>, Vector2<f64>);

/// A panel with its points.
#[derive(Clone, Copy)]
struct Measured {
    panel: Panel,
    bits: [Bit; 16],
    /// Of the curve within it, m.
    length: f64,
    middle: Vector2<f64>,
}

impl Smooth {
    pub(super) fn new(outline: impl Fn(f64) -> (Point2<f64>, Vector2<f64>) + Send + Sync + 'static) -> Self {
        let half = 0.5 / f64::from(PANELS);
        let panels = (0..PANELS).map(|i| Panel { middle: f64::from(2 * i + 1) * half, half });
        let panels = panels.map(|panel| Measured::new(&outline, panel)).collect();
        Self { outline: Arc::new(outline), panels }
    }

    /// An ellipse with its axes along x and y, m.
    pub(super) fn ellipse([a, b]: [f64; 2]) -> Self {
        Self::new(move |t| {
            let (sin, cos) = (TAU * t).sin_cos();
            (Point2::new(a * cos, b * sin), TAU * Vector2::new(-a * sin, b * cos))
        })
    }

    /// Points and `p × dp` there.
    pub(super) fn rays(&self) -> impl Iterator<Item = (Vector2<f64>, f64)> + '_ {
        self.panels.iter().flat_map(|measured| measured.bits).map(|(p, dp)| (p, p.perp(&dp)))
    }

    pub(super) fn sums(&self, centre: Vector2<f64>) -> Sums {
        let mut sums = Sums::default();
        for measured in self.panels.iter() {
            self.add_panel(&mut sums, measured, centre, DEPTH);
        }
        sums.distance /= 3.0;
        sums
    }

    fn add_panel(&self, sums: &mut Sums, measured: &Measured, centre: Vector2<f64>, depth: u32) {
        let Measured { panel, bits, length, middle } = measured;
        if depth == 0 || (middle - centre).norm() > CLEARANCE * length {
            bits.iter().for_each(|bit| add_bit(sums, *bit, centre));
            return;
        }
        let half = panel.half / 2.0;
        for middle in [panel.middle - half, panel.middle + half] {
            self.add_panel(sums, &Measured::new(&*self.outline, Panel { middle, half }), centre, depth - 1);
        }
    }
}

impl Measured {
    fn new(outline: &(impl Fn(f64) -> (Point2<f64>, Vector2<f64>) + ?Sized), panel: Panel) -> Self {
        let Panel { middle, half } = panel;
        let bits: [Bit; 16] = std::array::from_fn(|i| {
            let (x, w) = NODES[i / 2];
            let (p, derivative) = outline(middle + half * if i % 2 == 0 { x } else { -x });
            (p.coords, w * half * derivative)
        });
        let length = bits.iter().map(|(_, dp)| dp.norm()).sum();
        Self { panel, bits, length, middle: outline(middle).0.coords }
    }
}

/// Adds `r n ds`, `r (p − q)·n ds` and `n (p − q)ᵀ/r ds`.
fn add_bit(sums: &mut Sums, (p, dp): Bit, centre: Vector2<f64>) {
    let d = p - centre;
    let r = d.norm();
    let outward = Vector2::new(dp.y, -dp.x);
    sums.pull += r * outward;
    sums.distance += r * d.dot(&outward);
    if r > 0.0 {
        let direction = d / r;
        sums.bend[0] += outward.x * direction.x;
        sums.bend[1] += (outward.x * direction.y + outward.y * direction.x) / 2.0;
        sums.bend[2] += outward.y * direction.y;
    }
}

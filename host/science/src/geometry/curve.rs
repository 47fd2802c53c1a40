//! Curves of drawings as chords, each with a bound of how far they are from the curve.
//!
//! Chords begin and end on their curve. For circles the distance is that of the arc's middle from the chord's; an ellipse is
//! a circle seen through a linear map, which makes no distance larger than the longer semi-axis makes that of the unit circle; a
//! spline lies in the hull of its control points (weights above 0), so where these lie along a chord it does.
//!
//! Implements: blossoms (Ramshaw 1987) for the Bézier pieces of a spline, de Casteljau for halving them.
//! Frames: the drawing's. Units: those of the points; angles in rad.
//! Errors: none as such; what takes more than [`CHORDS_MAX`] chords, or is no curve, gives nothing.

use nalgebra::{Point2, Rotation2, Vector2, Vector3};

use super::segment::distance_to_segment;

/// Most chords of one curve: beyond it the error asked for is a mistake.
pub const CHORDS_MAX: u32 = 10_000;

/// A control point that lies beyond an end of a chord by no more than this share of it lies along it: rounding.
const ALONG_SLACK: f64 = 1e-9;

/// A curve as a line from point to point.
#[derive(Clone, Debug, PartialEq)]
pub struct Chords {
    /// From the curve's start to its end, both among them.
    pub points: Vec<Point2<f64>>,
    /// No point of the curve is further from them than this, and none of them from the curve.
    pub error: f64,
}

/// An edge that may be a circular arc, by its bulge: the tangent of a quarter of the arc's angle, positive where the arc
/// turns left, 1 for a half circle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BulgedEdge {
    /// Where it begins.
    pub start: Point2<f64>,
    /// Where it ends.
    pub end: Point2<f64>,
    /// 0 for a straight edge.
    pub bulge: f64,
}

/// How many chords of a circle's arc stay within an error of it; none if too many.
fn chord_count(angle: f64, radius: f64, error: f64) -> Option<u32> {
    let half = (1.0 - error / radius).clamp(-1.0, 1.0).acos();
    let count = (angle.abs() / (2.0 * half)).ceil().max(1.0);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked to be small and positive")]
    let whole = (count <= f64::from(CHORDS_MAX)).then_some(count as u32);
    whole
}

/// How far so many chords of a circle's arc are from it.
fn chord_error(angle: f64, radius: f64, chords: u32) -> f64 {
    radius * (1.0 - (angle / f64::from(2 * chords)).cos())
}

impl BulgedEdge {
    /// Angle of the arc, counter-clockwise positive, rad.
    fn angle(&self) -> f64 {
        4.0 * self.bulge.atan()
    }

    fn radius(&self) -> f64 {
        (self.end - self.start).norm() / (2.0 * (self.angle() / 2.0).sin().abs())
    }

    /// How many chords keep within an error of it; none if too many.
    fn count(&self, error: f64) -> Option<u32> {
        if self.bulge == 0.0 { Some(1) } else { chord_count(self.angle(), self.radius(), error) }
    }

    /// As chords that are no further from it than this; none if they would be too many.
    #[must_use]
    pub fn chords(&self, tolerance: f64) -> Option<Chords> {
        let count = self.count(tolerance)?;
        let error = if self.bulge == 0.0 { 0.0 } else { chord_error(self.angle(), self.radius(), count) };
        let chord = self.end - self.start;
        let at = |k: u32| {
            if k == 0 {
                return self.start;
            }
            // The point seen from the start at half the angle still to go, to the right of the chord for a positive
            // bulge.
            let (turned, left) = (self.angle() * f64::from(k) / f64::from(count) / 2.0, self.angle() / 2.0);
            let reach = turned.sin() / left.sin();
            let direction = Rotation2::new(-(left - turned)) * chord;
            self.start + reach * direction
        };
        Some(Chords { points: (0..count).map(at).chain([self.end]).collect(), error })
    }
}

/// A piece of an ellipse: `centre + axes[0] cos φ + axes[1] sin φ` from one φ to another. The axes are any two conjugate
/// half-diameters, so that every linear map of an ellipse is one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EllipticArc {
    /// Middle of the ellipse.
    pub centre: Point2<f64>,
    /// Conjugate half-diameters.
    pub axes: [Vector2<f64>; 2],
    /// φ at the start, rad.
    pub from: f64,
    /// By how much φ grows, rad; negative where it falls.
    pub sweep: f64,
}

impl EllipticArc {
    /// A piece of a circle from one angle (rad) on, counter-clockwise where the sweep is positive.
    #[must_use]
    pub fn circular(centre: Point2<f64>, radius: f64, from: f64, sweep: f64) -> Self {
        Self { centre, axes: [Vector2::new(radius, 0.0), Vector2::new(0.0, radius)], from, sweep }
    }

    /// The point at φ.
    #[must_use]
    pub fn at(&self, phi: f64) -> Point2<f64> {
        self.centre + self.axes[0] * phi.cos() + self.axes[1] * phi.sin()
    }

    /// The longer semi-axis.
    fn longer_axis(&self) -> f64 {
        let [a, b] = self.axes;
        // The larger singular value of the matrix of both.
        let (sum, product) = (a.norm_squared() + b.norm_squared(), a.perp(&b));
        ((sum + (sum * sum - 4.0 * product * product).max(0.0).sqrt()) / 2.0).sqrt()
    }

    /// As chords that are no further from it than this; none if they would be too many.
    #[must_use]
    pub fn chords(&self, tolerance: f64) -> Option<Chords> {
        let longer = self.longer_axis();
        if longer <= tolerance && self.sweep.abs() < 1.0 {
            return Some(Chords { points: vec![self.at(self.from), self.at(self.from + self.sweep)], error: longer });
        }
        // A whole ellipse of two chords would be a line.
        let least = if self.sweep.abs() > std::f64::consts::PI { 3 } else { 1 };
        let count = chord_count(self.sweep, longer, tolerance)?.max(least);
        let at = |k: u32| self.at(self.from + self.sweep * f64::from(k) / f64::from(count));
        Some(Chords { points: (0..=count).map(at).collect(), error: chord_error(self.sweep, longer, count) })
    }
}

/// A Bézier curve with weights: control points as (w x, w y, w).
#[derive(Clone, Debug, PartialEq)]
pub struct RationalBezier(Vec<Vector3<f64>>);

fn projected(point: &Vector3<f64>) -> Point2<f64> {
    Point2::new(point.x, point.y) / point.z
}

impl RationalBezier {
    /// A curve whose weights are all 1.
    ///
    /// # Panics
    /// Without two points.
    #[must_use]
    pub fn polynomial(points: &[Point2<f64>]) -> Self {
        assert!(points.len() > 1, "a curve has two ends");
        Self(points.iter().map(|point| Vector3::new(point.x, point.y, 1.0)).collect())
    }

    fn ends(&self) -> [Point2<f64>; 2] {
        [projected(&self.0[0]), projected(&self.0[self.0.len() - 1])]
    }

    /// How far the curve is from its chord at most, if it lies along it.
    fn off(&self, tolerance: f64) -> Option<f64> {
        let [start, end] = self.ends();
        let chord = end - start;
        let inner = || self.0[1..self.0.len() - 1].iter().map(projected);
        let distance = inner().map(|point| distance_to_segment(point, start, end)).fold(0.0, f64::max);
        let along = |point: Point2<f64>| {
            let along = (point - start).dot(&chord);
            along >= -ALONG_SLACK * chord.norm_squared() && along <= (1.0 + ALONG_SLACK) * chord.norm_squared()
        };
        if !inner().all(along) {
            // It may turn back beyond an end, which only something as small as the tolerance may.
            return (distance <= tolerance).then_some(distance);
        }
        // Σ Bᵢ(t) dᵢ over the inner points, whose weights add up to at most 1 − 2^(1 − degree) in the middle.
        let is_polynomial = self.0.iter().all(|point| (point.z - self.0[0].z).abs() <= 1e-15 * self.0[0].z);
        let degree = i32::try_from(self.0.len() - 1).unwrap_or(i32::MAX);
        Some(if is_polynomial { distance * (1.0 - 2.0_f64.powi(1 - degree)) } else { distance })
    }

    fn halves(&self) -> [Self; 2] {
        let (mut left, mut right, mut points) = (Vec::new(), Vec::new(), self.0.clone());
        while let (Some(first), Some(last)) = (points.first().copied(), points.last().copied()) {
            left.push(first);
            right.push(last);
            points = points.windows(2).map(|pair| (pair[0] + pair[1]) / 2.0).collect();
        }
        right.reverse();
        [Self(left), Self(right)]
    }

    /// As chords that are no further from it than this; none if they would be too many, or a weight is not above 0.
    #[must_use]
    pub fn chords(&self, tolerance: f64) -> Option<Chords> {
        let is_sound = |point: &Vector3<f64>| point.iter().all(|value| value.is_finite()) && point.z > 0.0;
        if !self.0.iter().all(is_sound) {
            return None;
        }
        let mut chords = Chords { points: vec![self.ends()[0]], error: 0.0 };
        let mut open = vec![self.clone()];
        while let Some(piece) = open.pop() {
            match piece.off(tolerance).filter(|off| *off <= tolerance) {
                Some(off) => {
                    chords.points.push(piece.ends()[1]);
                    chords.error = chords.error.max(off);
                }
                None => {
                    let [left, right] = piece.halves();
                    open.extend([right, left]);
                }
            }
            if chords.points.len() + open.len() > CHORDS_MAX as usize {
                return None;
            }
        }
        Some(chords)
    }
}

/// A B-spline with weights (NURBS), over the knots that its degree leaves inside.
#[derive(Clone, Debug, PartialEq)]
pub struct Spline {
    degree: usize,
    knots: Vec<f64>,
    points: Vec<Vector3<f64>>,
}

/// Highest degree of a spline: programs draw with 3, and hardly any with more than 5.
pub const DEGREE_MAX: usize = 15;

impl Spline {
    /// A spline with so many knots as control points, degree and one; a control point is its place and its weight.
    ///
    /// None if the numbers do not go together: knots that fall, too few of anything, a degree of 0 or above
    /// [`DEGREE_MAX`], a weight that is not above 0, or what is not finite.
    #[must_use]
    pub fn new(degree: usize, knots: Vec<f64>, points: &[(Point2<f64>, f64)]) -> Option<Self> {
        let counts_fit =
            (1..=DEGREE_MAX).contains(&degree) && points.len() > degree && knots.len() == points.len() + degree + 1;
        let knots_fit = counts_fit
            && knots.iter().all(|knot| knot.is_finite())
            && knots.windows(2).all(|pair| pair[0] <= pair[1])
            && knots[degree] < knots[points.len()];
        let points_fit = points
            .iter()
            .all(|(at, weight)| at.coords.iter().all(|x| x.is_finite()) && weight.is_finite() && *weight > 0.0);
        let weighted = |(at, weight): &(Point2<f64>, f64)| Vector3::new(at.x * weight, at.y * weight, *weight);
        (knots_fit && points_fit).then(|| Self { degree, knots, points: points.iter().map(weighted).collect() })
    }

    /// The polar form of the piece that begins at knot `span`: one argument for each degree.
    fn blossom(&self, span: usize, arguments: &[f64]) -> Vector3<f64> {
        let (p, knots) = (self.degree, &self.knots);
        let mut points = self.points[span - p..=span].to_vec();
        for (r, t) in (1..).zip(arguments) {
            for j in (r..=p).rev() {
                let i = span - p + j;
                let share = (t - knots[i]) / (knots[i + p + 1 - r] - knots[i]);
                points[j] = points[j - 1] * (1.0 - share) + points[j] * share;
            }
        }
        points[p]
    }

    /// Its pieces in order, one for each stretch between knots.
    #[must_use]
    pub fn pieces(&self) -> Vec<RationalBezier> {
        let spans = (self.degree..self.points.len()).filter(|span| self.knots[*span] < self.knots[span + 1]);
        let piece = |span: usize| {
            let control = |j: usize| {
                let arguments: Vec<f64> =
                    (0..self.degree).map(|k| self.knots[if k < self.degree - j { span } else { span + 1 }]).collect();
                self.blossom(span, &arguments)
            };
            RationalBezier((0..=self.degree).map(control).collect())
        };
        spans.map(piece).collect()
    }

    /// As chords that are no further from it than this; none if they would be too many.
    #[must_use]
    pub fn chords(&self, tolerance: f64) -> Option<Chords> {
        let mut whole = Chords { points: Vec::new(), error: 0.0 };
        for piece in self.pieces() {
            let chords = piece.chords(tolerance)?;
            let again = usize::from(!whole.points.is_empty());
            whole.points.extend(chords.points.into_iter().skip(again));
            whole.error = whole.error.max(chords.error);
            if whole.points.len() > CHORDS_MAX as usize {
                return None;
            }
        }
        Some(whole)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Points of a curve looked at by the oracle.
    const LOOKS: u32 = 400;

    /// Rounding, as a share of coordinates of about 1.
    const ROUNDING: f64 = 1e-12;

    fn distance(point: Point2<f64>, chords: &Chords) -> f64 {
        let pieces = chords.points.windows(2).map(|pair| distance_to_segment(point, pair[0], pair[1]));
        pieces.fold(f64::INFINITY, f64::min)
    }

    /// What a curve's chords promise, judged by points of the curve that are computed otherwise.
    fn check(chords: &Chords, tolerance: f64, at: impl Fn(f64) -> Point2<f64>) -> Result<(), TestCaseError> {
        let worst = (0..=LOOKS).map(|k| distance(at(f64::from(k) / f64::from(LOOKS)), chords)).fold(0.0, f64::max);
        prop_assert!(worst <= chords.error + ROUNDING, "{worst} off, {} promised", chords.error);
        prop_assert!(chords.error <= tolerance);
        prop_assert!((chords.points[0] - at(0.0)).norm() < ROUNDING);
        prop_assert!((chords.points[chords.points.len() - 1] - at(1.0)).norm() < ROUNDING);
        Ok(())
    }

    fn point() -> impl Strategy<Value = Point2<f64>> {
        (-1.0..1.0, -1.0..1.0).prop_map(|(x, y)| Point2::new(x, y))
    }

    /// De Boor's sum by the definition of the basis functions.
    fn basis(knots: &[f64], i: usize, p: usize, t: f64) -> f64 {
        if p == 0 {
            return if knots[i] <= t && t < knots[i + 1] { 1.0 } else { 0.0 };
        }
        let term = |from: f64, to: f64, value: f64| if to > from { value / (to - from) } else { 0.0 };
        let up = term(knots[i], knots[i + p], t - knots[i]) * basis(knots, i, p - 1, t);
        up + term(knots[i + 1], knots[i + p + 1], knots[i + p + 1] - t) * basis(knots, i + 1, p - 1, t)
    }

    proptest! {
        #[test]
        fn chords_of_an_ellipse_keep_their_promise(
            centre in point(), a in point(), b in point(), from in -4.0..4.0, sweep in -6.2..6.2, tolerance in 1e-4..0.1
        ) {
            let arc = EllipticArc { centre, axes: [a.coords, b.coords], from, sweep };
            let chords = arc.chords(tolerance).unwrap();
            check(&chords, tolerance.max(arc.longer_axis().min(tolerance)), |t| arc.at(from + sweep * t))?;
        }

        #[test]
        fn a_bulged_edge_is_the_arc_with_its_angle(start in point(), end in point(), bulge in -3.0..3.0, tolerance in 1e-4..0.1) {
            prop_assume!((end - start).norm() > 1e-3 && f64::abs(bulge) > 1e-3);
            let edge = BulgedEdge { start, end, bulge };
            // The centre lies on the chord's perpendicular, where radius and angle put it.
            let angle = 4.0 * f64::atan(bulge);
            let across = Rotation2::new(std::f64::consts::FRAC_PI_2) * (end - start);
            let centre = start + (end - start) / 2.0 + across / (2.0 * (angle / 2.0).tan());
            let from = start - centre;
            check(&edge.chords(tolerance).unwrap(), tolerance, |t| centre + Rotation2::new(angle * t) * from)?;
        }

        #[test]
        fn chords_of_a_spline_keep_their_promise(
            points in prop::collection::vec((point(), 0.2..4.0), 4..9), degree in 1..4_usize, steps in prop::collection::vec(0..3_u8, 16),
            is_clamped: bool, tolerance in 1e-4..0.1
        ) {
            let count = points.len() + degree + 1;
            let mut knots: Vec<f64> = steps.iter().cycle().take(count).scan(0.0, |at, step| { *at += f64::from(*step); Some(*at) }).collect();
            if is_clamped {
                let (first, last) = (knots[degree], knots[points.len()]);
                knots[..degree].fill(first);
                knots[points.len() + 1..].fill(last);
            }
            let Some(spline) = Spline::new(degree, knots.clone(), &points) else { return Ok(()) };
            // A knot as often as the degree and once more would tear the curve.
            prop_assume!((1..points.len()).all(|i| knots[i + degree] > knots[i]));
            let chords = spline.chords(tolerance).unwrap();
            let (from, to) = (knots[degree], knots[points.len()]);
            let at = |t: f64| {
                let t = (from + (to - from) * t).min(to - 1e-13 * (to - from));
                let weighted = points.iter().enumerate().map(|(i, (at, weight))| {
                    let share = basis(&knots, i, degree, t);
                    Vector3::new(at.x, at.y, 1.0) * (weight * share)
                });
                projected(&weighted.sum())
            };
            for k in 0..=LOOKS {
                let off = distance(at(f64::from(k) / f64::from(LOOKS)), &chords);
                prop_assert!(off <= chords.error + 1e-9, "{off} off, {} promised", chords.error);
            }
            prop_assert!(chords.error <= tolerance);
        }

        #[test]
        fn a_bezier_curve_halves_into_itself(points in prop::collection::vec(point(), 3..6), tolerance in 1e-4..0.1) {
            let curve = RationalBezier::polynomial(&points);
            // By Bernstein's polynomials.
            let n = points.len() - 1;
            let choose = |k: usize| (0..k).fold(1.0, |c, i| c * (n - i) as f64 / (i + 1) as f64);
            let power = |x: f64, k: usize| x.powi(i32::try_from(k).unwrap());
            let at = |t: f64| {
                let share = |k: usize| choose(k) * power(t, k) * power(1.0 - t, n - k);
                Point2::from(points.iter().enumerate().map(|(k, p)| p.coords * share(k)).sum::<Vector2<f64>>())
            };
            check(&curve.chords(tolerance).unwrap(), tolerance, at)?;
        }
    }

    #[test]
    fn a_circle_takes_few_chords_and_a_mistaken_tolerance_none() {
        let circle = EllipticArc::circular(Point2::origin(), 30.0, 0.0, std::f64::consts::TAU);
        assert_eq!(circle.chords(0.05).unwrap().points.len(), 56);
        assert_eq!(circle.chords(1e-9), None);
        assert_eq!(
            BulgedEdge { start: Point2::new(-30.0, 0.0), end: Point2::new(30.0, 0.0), bulge: 1.0 }.chords(1e-9),
            None
        );
    }

    #[test]
    fn a_circle_drawn_as_a_spline_is_one() {
        // The usual nine points of a whole circle of degree 2, with weights 1 and √½.
        let w = 0.5_f64.sqrt();
        let ring = [[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0]];
        let points: Vec<_> = ring
            .iter()
            .enumerate()
            .map(|(k, [x, y])| (Point2::new(f64::from(*x), f64::from(*y)), if k % 2 == 0 { 1.0 } else { w }))
            .collect();
        let knots = [0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4].map(f64::from).to_vec();
        let chords = Spline::new(2, knots, &points).unwrap().chords(1e-3).unwrap();
        assert!(chords.points.iter().all(|point| (point.coords.norm() - 1.0).abs() < ROUNDING));
        assert!(chords.error <= 1e-3 && chords.points.len() < 130, "{}", chords.points.len());
    }

    #[test]
    fn what_is_no_spline_is_none() {
        let points = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]].map(|p| (Point2::from(p), 1.0));
        let knots = [0.0, 0.0, 0.0, 1.0, 1.0, 1.0];
        assert!(Spline::new(2, knots.to_vec(), &points).is_some());
        assert_eq!(Spline::new(0, knots.to_vec(), &points), None);
        assert_eq!(Spline::new(2, knots[1..].to_vec(), &points), None);
        assert_eq!(Spline::new(2, vec![0.0; 6], &points), None);
        assert_eq!(Spline::new(2, vec![0.0, 0.0, 0.0, 1.0, 0.5, 1.0], &points), None);
        assert_eq!(Spline::new(2, vec![0.0, 0.0, f64::NAN, 1.0, 1.0, 1.0], &points), None);
        assert_eq!(Spline::new(2, knots.to_vec(), &points.map(|(at, _)| (at, -1.0))), None);
    }
}

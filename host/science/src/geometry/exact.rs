//! Exact decisions about segments: where one lies from another, and the order of points along one.
//!
//! A crossing of two segments has no exact coordinates in floating point, so it is never compared by coordinates: it is
//! kept as the pair of segments that cross, and decisions about it are signs of polynomials in the coordinates of the
//! given vertices. A floating-point filter decides nearly all of them; what is left is decided by Shewchuk's expansions
//! (sums of doubles that represent a number exactly), so the outcome depends on no tolerance.
//!
//! Assumes: coordinates are 0 or between [`COORDINATE_MIN_M`] and 1e9 in magnitude, so nothing under- or overflows.
//! Units: m. Errors: none.

use std::cmp::Ordering;

use nalgebra::Point2;

/// Smaller coordinates count as 0, m: thirty orders of magnitude below the least polygon, and large enough that
/// products of four differences of coordinates keep all their bits.
pub(crate) const COORDINATE_MIN_M: f64 = 1e-39;

/// Bound on the relative rounding error of a 2×2 determinant of differences (Shewchuk 1997, `ccwerrboundA`), rounded
/// up.
const TURN_ERROR: f64 = 3.4e-16;

/// Bound on the rounding of a quotient and of what leads to it, beside the error of its numerator and denominator.
const QUOTIENT_ERROR: f64 = 1e-15;

/// A segment from `start` to `end`, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Segment {
    pub start: Point2<f64>,
    pub end: Point2<f64>,
}

/// Twice the area of the triangle `a b c`: exact in its sign, positive for a left turn; and a bound on the value's
/// error.
pub(crate) fn turn(a: Point2<f64>, b: Point2<f64>, c: Point2<f64>) -> (f64, f64) {
    let (left, right) = ((a.x - c.x) * (b.y - c.y), (a.y - c.y) * (b.x - c.x));
    let (value, error) = (left - right, TURN_ERROR * (left.abs() + right.abs()));
    if value.abs() > error {
        return (value, error);
    }
    let coordinates = |p: Point2<f64>| robust::Coord { x: p.x, y: p.y };
    (robust::orient2d(coordinates(a), coordinates(b), coordinates(c)), error)
}

/// What cuts a segment at a point.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Cut {
    /// A point on the segment, or for a sweep the vertical line through a point.
    At {
        /// Which coordinate tells where.
        axis: usize,
        /// The coordinate as given.
        value: f64,
    },
    /// A segment that crosses it in the interior of both.
    Crossing(Segment),
}

impl Cut {
    /// A point that lies on the segment.
    pub(crate) fn point(segment: Segment, point: Point2<f64>) -> Self {
        let extent = segment.end - segment.start;
        let axis = usize::from(extent.y.abs() > extent.x.abs());
        Self::At { axis, value: point[axis] }
    }

    /// Where along the segment, from 0 to 1, and a bound on the error.
    pub(crate) fn parameter(self, segment: Segment) -> (f64, f64) {
        match self {
            Self::At { axis, value } => {
                let t = (value - segment.start[axis]) / (segment.end[axis] - segment.start[axis]);
                (t, QUOTIENT_ERROR)
            }
            Self::Crossing(other) => {
                let from = turn(other.start, other.end, segment.start);
                quotient(from, turn(other.start, other.end, segment.end))
            }
        }
    }

    /// The same as an exact fraction: numerator and denominator.
    fn fraction(self, segment: Segment) -> (Expansion, Expansion) {
        match self {
            Self::At { axis, value } => {
                let start = segment.start[axis];
                (Expansion::difference(value, start), Expansion::difference(segment.end[axis], start))
            }
            Self::Crossing(other) => {
                let from = exact_turn(other, segment.start);
                let over = from.minus(&exact_turn(other, segment.end));
                (from, over)
            }
        }
    }

    /// The order of two cuts along a segment, exactly.
    pub(crate) fn exact_order(self, other: Self, segment: Segment) -> Ordering {
        let ((p, q), (r, s)) = (self.fraction(segment), other.fraction(segment));
        let difference = p.times(&s).minus(&r.times(&q));
        let sign = difference.sign() * q.sign() * s.sign();
        sign.cmp(&0)
    }
}

/// Where the line crosses a segment whose ends are at these signed distances from it.
pub(crate) fn quotient((from, from_error): (f64, f64), (to, to_error): (f64, f64)) -> (f64, f64) {
    let over = from - to;
    (from / over, QUOTIENT_ERROR + (from_error + to_error) / over.abs())
}

/// The sign of the cross product of two segments' directions, exactly: positive if the second turns left from the
/// first.
pub(crate) fn cross_sign(first: Segment, second: Segment) -> i32 {
    let directions =
        |segment: Segment| [0, 1].map(|axis| Expansion::difference(segment.end[axis], segment.start[axis]));
    let ([a, b], [c, d]) = (directions(first), directions(second));
    a.times(&d).minus(&b.times(&c)).sign()
}

/// Which of two segments is higher at the abscissa `x`, which both span, or just right of it where they meet there.
pub(crate) fn order_above(first: Segment, second: Segment, x: f64) -> Ordering {
    let (a, b) = (rough_height(first, x), rough_height(second, x));
    if (a.0 - b.0).abs() > a.1 + b.1 {
        return a.0.total_cmp(&b.0);
    }
    let height = |segment: Segment| {
        let extent = [0, 1].map(|axis| Expansion::difference(segment.end[axis], segment.start[axis]));
        let along = Expansion::difference(x, segment.start.x);
        let [dx, dy] = extent;
        (Expansion::from(segment.start.y).times(&dx).plus(&dy.times(&along)), dx)
    };
    let ((p, q), (r, s)) = (height(first), height(second));
    let sign = p.times(&s).minus(&r.times(&q)).sign() * q.sign() * s.sign();
    let rightward = |segment: Segment| match segment.end.x > segment.start.x {
        true => segment,
        false => Segment { start: segment.end, end: segment.start },
    };
    sign.cmp(&0).then_with(|| 0.cmp(&cross_sign(rightward(first), rightward(second))))
}

/// The ordinate of a segment at an abscissa that it spans, and a bound on its error: a dozen roundings of its parts.
fn rough_height(segment: Segment, x: f64) -> (f64, f64) {
    let extent = segment.end - segment.start;
    let rise = extent.y * ((x - segment.start.x) / extent.x);
    (segment.start.y + rise, 12.0 * f64::EPSILON * (segment.start.y.abs() + extent.y.abs()))
}

/// Twice the area of the triangle of a segment and a point.
fn exact_turn(segment: Segment, c: Point2<f64>) -> Expansion {
    let difference = |p: Point2<f64>, axis: usize| Expansion::difference(p[axis], c[axis]);
    let left = difference(segment.start, 0).times(&difference(segment.end, 1));
    left.minus(&difference(segment.start, 1).times(&difference(segment.end, 0)))
}

/// A number as a sum of doubles that do not overlap, least first, without zeros.
#[derive(Clone, Debug, PartialEq)]
struct Expansion(Vec<f64>);

impl From<f64> for Expansion {
    fn from(value: f64) -> Self {
        Self(if value == 0.0 { Vec::new() } else { vec![value] })
    }
}

impl Expansion {
    /// `a − b`, exactly.
    fn difference(a: f64, b: f64) -> Self {
        Self::from(a).grown(-b)
    }

    fn grown(mut self, value: f64) -> Self {
        let mut carry = value;
        self.0.iter_mut().for_each(|part| (carry, *part) = two_sum(carry, *part));
        self.0.push(carry);
        self.0.retain(|&part| part != 0.0);
        self
    }

    fn plus(self, other: &Self) -> Self {
        other.0.iter().fold(self, |sum, &part| sum.grown(part))
    }

    fn minus(&self, other: &Self) -> Self {
        other.0.iter().fold(self.clone(), |sum, &part| sum.grown(-part))
    }

    fn times(&self, other: &Self) -> Self {
        let mut product = Self(Vec::with_capacity(2 * self.0.len() * other.0.len()));
        for &a in &self.0 {
            for &b in &other.0 {
                let high = a * b;
                product = product.grown(a.mul_add(b, -high)).grown(high);
            }
        }
        product
    }

    /// −1, 0 or 1.
    fn sign(&self) -> i32 {
        self.0.last().map_or(0, |&largest| if largest > 0.0 { 1 } else { -1 })
    }
}

/// Sum and rounding error (Knuth).
fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let b_part = sum - a;
    (sum, (a - (sum - b_part)) + (b - b_part))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn segment(coordinates: [i32; 4]) -> Segment {
        let [a, b, c, d] = coordinates.map(f64::from);
        Segment { start: Point2::new(a, b), end: Point2::new(c, d) }
    }

    /// The same in integers, which share nothing with expansions.
    fn integer_turn(line: [i32; 4], [x, y]: [i32; 2]) -> i128 {
        let [ax, ay, bx, by] = line.map(i128::from);
        let (x, y) = (i128::from(x), i128::from(y));
        (ax - x) * (by - y) - (ay - y) * (bx - x)
    }

    fn ends(line: [i32; 4]) -> [[i32; 2]; 2] {
        [[line[0], line[1]], [line[2], line[3]]]
    }

    fn crosses(a: [i32; 4], b: [i32; 4]) -> bool {
        let apart =
            |line: [i32; 4], [p, q]: [[i32; 2]; 2]| integer_turn(line, p).signum() * integer_turn(line, q).signum() < 0;
        apart(a, ends(b)) && apart(b, ends(a))
    }

    fn any_line(limit: i32) -> impl Strategy<Value = [i32; 4]> {
        [-limit..limit, -limit..limit, -limit..limit, -limit..limit]
    }

    proptest! {
        // Few random segments cross each other: most draws are rejected.
        #![proptest_config(ProptestConfig { max_global_rejects: 1 << 20, ..ProptestConfig::default() })]

        #[test]
        fn crossings_are_ordered_as_fractions_of_integers_are(
            s in any_line(6), a in any_line(6), b in any_line(6), shift in 0..3_i32,
        ) {
            prop_assume!(crosses(s, a) && crosses(s, b));
            let fraction = |line: [i32; 4]| {
                let [from, to] = ends(s).map(|p| integer_turn(line, p));
                if from > to { (from, from - to) } else { (-from, to - from) }
            };
            let ((p, q), (r, t)) = (fraction(a), fraction(b));
            // A shift by a power of two with few bits in common makes rounding matter and changes no order.
            let far = |line: [i32; 4]| {
                let Segment { start, end } = segment(line);
                let offset = nalgebra::Vector2::repeat(f64::from(shift) * (2.0_f64).powi(40));
                Segment { start: start + offset, end: end + offset }
            };
            let [s, a, b] = [s, a, b].map(far);
            prop_assert_eq!(Cut::Crossing(a).exact_order(Cut::Crossing(b), s), (p * t).cmp(&(r * q)));
            let ((t_a, e_a), (t_b, e_b)) = (Cut::Crossing(a).parameter(s), Cut::Crossing(b).parameter(s));
            if (t_a - t_b).abs() > e_a + e_b {
                prop_assert_eq!(t_a.total_cmp(&t_b), (p * t).cmp(&(r * q)));
            }
        }

        #[test]
        fn expansions_compute_as_integers_do(a in any::<i32>(), b in any::<i32>(), c in any::<i32>(), d in any::<i32>()) {
            let exact = |x: i32| Expansion::from(f64::from(x));
            let value = exact(a).times(&exact(b)).times(&exact(c)).minus(&exact(d).times(&exact(d)).times(&exact(b)));
            let [a, b, c, d] = [a, b, c, d].map(i128::from);
            prop_assert_eq!(i128::from(value.sign()), (a * b * c - d * d * b).signum());
        }

        #[test]
        fn the_higher_segment_is_the_one_above(a in any_line(5), b in any_line(5), x in -5..5_i32) {
            let spans = |[p, _, q, _]: [i32; 4]| p.min(q) <= x && x < p.max(q);
            prop_assume!(spans(a) && spans(b));
            // Heights at x and just right of it, over the common denominator.
            let height = |[ax, ay, bx, by]: [i32; 4], at: i128| {
                let [ax, ay, bx, by] = [ax, ay, bx, by].map(i128::from);
                let scale = if bx > ax { 1 } else { -1 };
                (scale * (1000 * ay * (bx - ax) + (by - ay) * (at - 1000 * ax)), scale * (bx - ax))
            };
            let order = |at: i128| {
                let ((p, q), (r, s)) = (height(a, at), height(b, at));
                (p * s).cmp(&(r * q))
            };
            let at = 1000 * i128::from(x);
            let expected = order(at).then(order(at + 1));
            prop_assert_eq!(order_above(segment(a), segment(b), f64::from(x)), expected);
        }
    }
}

//! Zeros of a function that may be undefined in places, those that only touch zero too.
//!
//! A function of one place is looked at on a grid; where it starts or stops being defined, the border is found by
//! halving. Sign changes are bracketed and closed in on; where the function turns back near zero, its nearest place is
//! found, for two zeros may hide there, or one double zero.
//!
//! Assumes: nothing finer than the grid happens twice between two of its places.
//! Units: the caller's. Errors: none.

/// Halvings of an interval that has the function's border inside: a millionth of it is left.
const BORDER_HALVINGS: usize = 20;

/// Steps that close in on a zero: the Illinois method needs some ten, bisection 60.
const CLOSING_STEPS: usize = 80;

/// Steps of the golden section: each takes off a third; what is left cannot be told from its middle.
const GOLDEN_STEPS: usize = 60;

/// A value that needs no closing in on, as a share of 1: below what a simulation is off by.
const ZERO: f64 = 1e-13;

/// A parabola's nearest value, as a share of the nearest found, from which on the function is taken to stay away from
/// zero.
const AWAY_SHARE: f64 = 0.5;

/// Values whose spread is below this, as a share of 1, are one value: the function does not depend on the place.
const CONSTANT: f64 = 1e-10;

/// A zero, or as near to zero as the function comes around there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct NearZero {
    pub(crate) at: f64,
    pub(crate) value: f64,
    /// Whether it is one of a continuum.
    pub(crate) anywhere: bool,
}

/// A place and the function's value there.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Look {
    pub(crate) at: f64,
    pub(crate) value: f64,
}

/// All zeros between the ends of a grid (increasing), and all places where the function comes within `tolerance` of
/// zero and turns.
pub(crate) fn near_zeros(function: &dyn Fn(f64) -> Option<f64>, grid: &[f64], tolerance: f64) -> Vec<NearZero> {
    stretches(function, grid).iter().flat_map(|stretch| within(function, stretch, tolerance)).collect()
}

/// Stretches of the grid on which the function is defined, with their borders.
fn stretches(function: &dyn Fn(f64) -> Option<f64>, grid: &[f64]) -> Vec<Vec<Look>> {
    let look = |at: f64| function(at).map(|value| Look { at, value });
    let looks: Vec<_> = grid.iter().map(|&at| (at, look(at))).collect();
    let mut stretches: Vec<Vec<Look>> = Vec::new();
    let mut open = false;
    for (index, &(at, here)) in looks.iter().enumerate() {
        let before = index.checked_sub(1).map(|index| looks[index]);
        match (before, here) {
            (Some((outside, None)), Some(inside)) => stretches.push(vec![border(&look, inside, outside), inside]),
            (Some((_, Some(inside))), None) => {
                stretches[..].last_mut().into_iter().for_each(|stretch| stretch.push(border(&look, inside, at)))
            }
            (_, Some(inside)) if open => stretches[..].last_mut().into_iter().for_each(|stretch| stretch.push(inside)),
            (_, Some(inside)) => stretches.push(vec![inside]),
            (_, None) => {}
        }
        open = here.is_some();
    }
    stretches
}

/// The last defined place on the way from `inside` to `outside`.
pub(crate) fn border(look: &dyn Fn(f64) -> Option<Look>, mut inside: Look, mut outside: f64) -> Look {
    for _ in 0..BORDER_HALVINGS {
        let middle = 0.5 * (inside.at + outside);
        match look(middle) {
            Some(found) => inside = found,
            None => outside = middle,
        }
    }
    inside
}

fn within(function: &dyn Fn(f64) -> Option<f64>, stretch: &[Look], tolerance: f64) -> Vec<NearZero> {
    let spread = |value: fn(f64, f64) -> f64| stretch.iter().map(|look| look.value).fold(stretch[0].value, value);
    if spread(f64::max) - spread(f64::min) < CONSTANT && stretch.len() > 2 {
        let middle = stretch[stretch.len() / 2];
        let near = NearZero { at: middle.at, value: middle.value, anywhere: true };
        return if middle.value.abs() <= tolerance { vec![near] } else { Vec::new() };
    }
    let mut found = Vec::new();
    let mut take = |look: Look| found.push(NearZero { at: look.at, value: look.value, anywhere: false });
    stretch.iter().filter(|look| look.value == 0.0).for_each(|&look| take(look));
    for pair in stretch.windows(2).filter(|pair| changes_sign(pair[0], pair[1])) {
        take(closed_in(function, pair[0], pair[1]));
    }
    for three in stretch.windows(3) {
        let [left, middle, right] = [three[0], three[1], three[2]];
        if turns_at(left, middle, right) {
            turning(function, [left, middle, right], tolerance).into_iter().for_each(&mut take);
        }
    }
    for end in ends(stretch).into_iter().flatten().filter(|end| end.value.abs() <= tolerance && end.value != 0.0) {
        take(end);
    }
    found
}

fn changes_sign(a: Look, b: Look) -> bool {
    (a.value < 0.0 && b.value > 0.0) || (a.value > 0.0 && b.value < 0.0)
}

/// Whether the function, on one side of zero, comes nearest to it around the middle place.
fn turns_at(left: Look, middle: Look, right: Look) -> bool {
    let same_side = left.value * middle.value > 0.0 && middle.value * right.value > 0.0;
    same_side && middle.value.abs() <= left.value.abs() && middle.value.abs() <= right.value.abs()
}

/// Ends of a stretch at which the function comes nearest to zero.
fn ends(stretch: &[Look]) -> [Option<Look>; 2] {
    let nearest = |end: &Look, next: Option<&Look>| {
        let away = next.is_none_or(|next| next.value * end.value > 0.0 && next.value.abs() > end.value.abs());
        away.then_some(*end)
    };
    match stretch {
        [] => [None, None],
        [only] => [Some(*only), None],
        [first, second, ..] => {
            [nearest(first, Some(second)), nearest(&stretch[stretch.len() - 1], stretch.get(stretch.len() - 2))]
        }
    }
}

/// The zero between two places of opposite sign, by the Illinois method.
fn closed_in(function: &dyn Fn(f64) -> Option<f64>, a: Look, b: Look) -> Look {
    let (mut a, mut b) = (a, b);
    // A place that is kept twice in a row counts half from then on, which makes it move.
    let mut kept: Option<bool> = None;
    let (mut weight_a, mut weight_b) = (1.0, 1.0);
    for _ in 0..CLOSING_STEPS {
        let (value_a, value_b) = (a.value * weight_a, b.value * weight_b);
        let at = (a.at * value_b - b.at * value_a) / (value_b - value_a);
        let at = if at > a.at.min(b.at) && at < a.at.max(b.at) { at } else { 0.5 * (a.at + b.at) };
        // No number lies between the two any more.
        if at <= a.at.min(b.at) || at >= a.at.max(b.at) {
            break;
        }
        let Some(value) = function(at) else { break };
        let middle = Look { at, value };
        if value.abs() < ZERO {
            return middle;
        }
        let keeps_b = (value > 0.0) == (a.value > 0.0);
        let share = if kept == Some(keeps_b) { 0.5 } else { 1.0 };
        if keeps_b {
            (a, weight_a, weight_b) = (middle, 1.0, share * weight_b);
        } else {
            (b, weight_b, weight_a) = (middle, 1.0, share * weight_a);
        }
        kept = Some(keeps_b);
    }
    if a.value.abs() < b.value.abs() { a } else { b }
}

/// The two zeros that a function turns out to have where it turns, or where it is nearest to zero if that is near
/// enough.
fn turning(function: &dyn Fn(f64) -> Option<f64>, [left, middle, right]: [Look; 3], tolerance: f64) -> Vec<Look> {
    const GOLDEN: f64 = 0.381_966_011_250_105_1;
    let (mut left, mut middle, mut right) = (left, middle, right);
    for _ in 0..GOLDEN_STEPS {
        if stays_away([left, middle, right], tolerance) {
            return Vec::new();
        }
        let larger_right = right.at - middle.at > middle.at - left.at;
        let at = middle.at + GOLDEN * if larger_right { right.at - middle.at } else { left.at - middle.at };
        let Some(value) = function(at).filter(|_| (at - middle.at).abs() > 0.0) else { break };
        let look = Look { at, value };
        if value == 0.0 {
            return vec![look];
        }
        if changes_sign(look, middle) {
            return vec![closed_in(function, left, look), closed_in(function, look, right)];
        }
        match (value.abs() < middle.value.abs(), larger_right) {
            (true, true) => (left, middle) = (middle, look),
            (true, false) => (right, middle) = (middle, look),
            (false, true) => right = look,
            (false, false) => left = look,
        }
    }
    if middle.value.abs() <= tolerance { vec![middle] } else { Vec::new() }
}

/// Whether a parabola through three places stays so far from zero that the function will.
fn stays_away([left, middle, right]: [Look; 3], tolerance: f64) -> bool {
    let (to_left, to_right) = (middle.at - left.at, right.at - middle.at);
    let (slope_left, slope_right) = ((middle.value - left.value) / to_left, (right.value - middle.value) / to_right);
    let curvature = (slope_right - slope_left) / (to_left + to_right);
    let slope = (slope_right * to_left + slope_left * to_right) / (to_left + to_right);
    let nearest = middle.value - slope * slope / (4.0 * curvature);
    // Written so that a parabola that is none does not count.
    nearest * middle.value > 0.0 && nearest.abs() > AWAY_SHARE * middle.value.abs() && nearest.abs() > 10.0 * tolerance
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    const GRID: [f64; 9] = [-1.0, -0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75, 1.0];

    fn places(function: &dyn Fn(f64) -> Option<f64>, tolerance: f64) -> Vec<f64> {
        let mut places: Vec<_> = near_zeros(function, &GRID, tolerance).iter().map(|near| near.at).collect();
        places.sort_by(f64::total_cmp);
        places
    }

    fn assert_near(got: &[f64], wanted: &[f64], tolerance: f64) {
        let near = got.len() == wanted.len() && got.iter().zip(wanted).all(|(a, b)| (a - b).abs() < tolerance);
        assert!(near, "{got:?}, wanted {wanted:?}");
    }

    #[test]
    fn simple_zeros_are_found_to_rounding() {
        assert_near(
            &places(&|x| Some((3.0 * x).sin() - 0.2), 0.0),
            &[0.2_f64.asin() / 3.0, (PI - 0.2_f64.asin()) / 3.0],
            1e-12,
        );
        assert_near(&places(&|x| Some(x * (x - 0.3) * (x + 0.61)), 0.0), &[-0.61, 0.0, 0.3], 1e-12);
    }

    #[test]
    fn two_zeros_within_one_step_and_a_double_zero_are_not_lost() {
        assert_near(&places(&|x| Some((x - 0.31).powi(2) - 1e-6), 0.0), &[0.309, 0.311], 1e-9);
        assert_near(&places(&|x| Some((x - 0.31).powi(2)), 1e-12), &[0.31], 1e-6);
        assert_near(&places(&|x| Some((x - 0.31).powi(2) + 1e-3), 1e-2), &[0.31], 1e-6);
        assert!(places(&|x| Some((x - 0.31).powi(2) + 1e-3), 1e-4).is_empty());
    }

    #[test]
    fn borders_count_where_the_function_is_near_zero() {
        let half = |x: f64| (x > 0.1).then_some(x - 0.1 + 1e-5);
        assert_near(&places(&half, 1e-4), &[0.1], 1e-6);
        assert!(places(&half, 1e-6).is_empty());
        // Two stretches, a zero in each.
        let gap = |x: f64| (x.abs() > 0.4).then_some(x.abs() - 0.6);
        assert_near(&places(&gap, 0.0), &[-0.6, 0.6], 1e-12);
    }

    #[test]
    fn a_function_that_does_not_depend_on_the_place_is_said_to() {
        let near = near_zeros(&|_| Some(1e-12), &GRID, 1e-6);
        assert!(near.len() == 1 && near[0].anywhere, "{near:?}");
        assert!(near_zeros(&|_| Some(1e-3), &GRID, 1e-6).is_empty());
        assert!(near_zeros(&|_| None, &GRID, 1.0).is_empty());
    }
}

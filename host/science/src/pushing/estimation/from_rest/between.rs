//! What lies between guesses that were played: about how much it may cost.
//!
//! What a guess leaves unexplained changes nearly evenly from one to the next, mostly also where the contact does something else:
//! when it changes is no jump either. So the least that is left between some is that of a line or a plane through theirs, and a
//! little less.
//!
//! Units: standard deviations. Errors: none.

use nalgebra::{DVector, Matrix4, RowVector4};

/// By how much the change from one guess to the next may be off an even one, as a share of it.
const UNEVEN: f64 = 0.2;

/// Where a plane begins, of its corners: at the first, but for what they are off it.
const BEGINNING: RowVector4<f64> = RowVector4::new(0.75, 0.25, 0.25, -0.25);

/// Its two ways, from the first two corners to the others and from every first of two to the second.
const WAYS: [RowVector4<f64>; 2] = [RowVector4::new(-0.5, -0.5, 0.5, 0.5), RowVector4::new(-0.5, 0.5, -0.5, 0.5)];

/// About the least cost of what lies between four guesses, by what each leaves unexplained; between two each is given twice.
pub(super) fn least_cost([a, b, c, d]: [&DVector<f64>; 4]) -> f64 {
    let corners = [a, b, c, d];
    let products = Matrix4::from_fn(|row, column| corners[row].dot(corners[column]));
    let dot = |one: &RowVector4<f64>, other: &RowVector4<f64>| (one * products).dot(other);
    let (here, by) = (dot(&BEGINNING, &BEGINNING), WAYS.map(|way| dot(&BEGINNING, &way)));
    let (own, across) = (WAYS.map(|way| dot(&way, &way).max(0.0)), dot(&WAYS[0], &WAYS[1]));
    let cost = |[x, y]: [f64; 2]| {
        let squared = here + 2.0 * (x * by[0] + y * by[1] + x * y * across) + x * x * own[0] + y * y * own[1];
        let uneven = UNEVEN * (x * own[0].sqrt() + y * own[1].sqrt());
        (squared.max(0.0).sqrt() - uneven).max(0.0).powi(2)
    };
    // The lowest place on a line, one of the two numbers being held.
    let lowest = |number: usize, held: f64| {
        let slope = by[number] + held * across;
        if own[number] > 0.0 { (-slope / own[number]).clamp(0.0, 1.0) } else { 0.0 }
    };
    let sides = [0.0, 1.0].into_iter().flat_map(|held| [[lowest(0, held), held], [held, lowest(1, held)]]);
    let determinant = own[0] * own[1] - across * across;
    let inside = [by[1] * across - by[0] * own[1], by[0] * across - by[1] * own[0]].map(|of| of / determinant);
    let inside = inside.iter().all(|share| (0.0..=1.0).contains(share)).then_some(inside);
    sides.chain(inside).map(cost).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Draw;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn it_is_the_least_of_an_even_change_less_what_is_uneven(case in 0..100_000_usize) {
            /// Places looked at to a side.
            const LOOKED: u32 = 40;
            let mut draw = Draw::case(31, case);
            let mut vector = || DVector::from_fn(6, |_, _| draw.normal());
            let (rest, a, mut b) = (vector() * 2.0, vector(), vector());
            if case % 3 == 0 {
                // A line.
                b.fill(0.0);
            }
            let (next, beside) = (&rest + &a, &rest + &b);
            let found = least_cost([&rest, &beside, &next, &(&beside + &a)]);
            let shares = || (0..=LOOKED).map(|share| f64::from(share) / f64::from(LOOKED));
            let places = shares().flat_map(|x| shares().map(move |y| (x, y)));
            let even = places.clone().map(|(x, y)| (&rest + &a * x + &b * y).norm());
            let least = even.fold(f64::INFINITY, f64::min);
            let widest = UNEVEN * (a.norm() + b.norm());
            prop_assert!(found <= least * least + 1e-9, "{found} above {}", least * least);
            // A step of the places looked at is a fortieth of a way.
            let between = (a.norm() + b.norm()) / f64::from(LOOKED);
            prop_assert!(found.sqrt() >= least - widest - between, "{found} below {least} less {widest}");
        }
    }
}

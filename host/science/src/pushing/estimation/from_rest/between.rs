//! What lies between guesses that were played: about how much it may cost.
//!
//! What a guess leaves unexplained changes nearly evenly from one to the next, mostly also where the contact does something else:
//! when it changes is no jump either. So the least that is left between some is that of a line or a plane through theirs, and a
//! little less.
//!
//! Units: standard deviations. Errors: none.

use nalgebra::DVector;

/// By how much the change from one guess to the next may be off an even one, as a share of it.
const UNEVEN: f64 = 0.2;

/// What a guess leaves unexplained, and how that changes to one side of it, or to two.
pub(super) struct Nearby<'a> {
    pub(super) rest: &'a DVector<f64>,
    /// To the next guess; nothing where there is none.
    pub(super) ways: [Option<&'a DVector<f64>>; 2],
}

impl Nearby<'_> {
    /// About the least cost up to the next guesses.
    pub(super) fn least_cost(&self) -> f64 {
        let dot = |a: Option<&DVector<f64>>, b: Option<&DVector<f64>>| a.zip(b).map_or(0.0, |(a, b)| a.dot(b));
        let [a, b] = self.ways;
        let rest = Some(self.rest);
        let (here, by) = (self.rest.norm_squared(), [dot(rest, a), dot(rest, b)]);
        let (own, across) = ([dot(a, a), dot(b, b)], dot(a, b));
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
            let vector = |draw: &mut Draw| DVector::from_fn(6, |_, _| draw.normal());
            let (rest, a, b) = (vector(&mut draw) * 2.0, vector(&mut draw), vector(&mut draw));
            let ways = [(case % 3 != 0).then_some(&a), (case % 3 != 1).then_some(&b)];
            let found = Nearby { rest: &rest, ways }.least_cost();
            let step = |way: Option<&DVector<f64>>, share: f64| way.map_or_else(|| &rest * 0.0, |way| way * share);
            let shares = || (0..=LOOKED).map(|share| f64::from(share) / f64::from(LOOKED));
            let places = shares().flat_map(|x| shares().map(move |y| (x, y)));
            let even = places.clone().map(|(x, y)| (&rest + step(ways[0], x) + step(ways[1], y)).norm());
            let least = even.fold(f64::INFINITY, f64::min);
            let widest = UNEVEN * ways.iter().flatten().map(|way| way.norm()).sum::<f64>();
            prop_assert!(found <= least * least + 1e-9, "{found} above {}", least * least);
            // A step of the places looked at is a fortieth of a way.
            let between = (a.norm() + b.norm()) / f64::from(LOOKED);
            prop_assert!(found.sqrt() >= least - widest - between, "{found} below {least} less {widest}");
        }
    }
}

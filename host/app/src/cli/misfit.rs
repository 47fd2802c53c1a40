//! What a person is told where no pose explains a push: the likeliest mistake, or what else to ask.

use palpate::gravity::GRAVITY_ASSUMED;
use palpate::pushing::estimation::from_rest::misfit::{self, Lengths, Misfit, Mistake};
use palpate::pushing::estimation::from_rest::{KnownFromRest, WindowedForce};

use crate::threads::PATIENT;
use crate::width::folded;

/// Seeks what would explain it, and says so.
pub(super) fn explain(known: &KnownFromRest, measured: &WindowedForce) -> String {
    note!("no pose fits; looking for the likeliest mistake");
    in_words(known, &misfit::misfit(known, measured, &PATIENT).found)
}

fn in_words(known: &KnownFromRest, misfit: &Misfit) -> String {
    let mut sentences: Vec<_> = misfit.mistakes.iter().map(|likely| sentence(known, &likely.mistake)).collect();
    sentences.dedup();
    if misfit.onset_angle > std::f64::consts::FRAC_PI_2 {
        let angle = misfit.onset_angle.to_degrees();
        sentences.insert(
            0,
            format!(
                "The first force on the finger is {angle:.0}° away from the reverse of its acceleration: a part that is \
                 begun to be pushed resists it, by less than 90°."
            ),
        );
    }
    if misfit.mistakes.is_empty() {
        sentences.push(
            "None of the usual mistakes explains it (signs, axes, ramps, radius, units, mu, a drifting zero): is it this part, on this face, did \
             the finger move as stated, was it at rest before, did it touch one edge alone?"
                .to_owned(),
        );
    }
    folded(&sentences.join(" "))
}

fn sentence(known: &KnownFromRest, mistake: &Mistake) -> String {
    match *mistake {
        Mistake::Reversed => {
            "With all forces reversed a pose fits: they must be those on the finger, not those on the \
                              part, or the motion goes the other way."
                .to_owned()
        }
        Mistake::Turned { quarters } => format!(
            "With the motion turned by {}° against the force a pose fits: both must be told in the finger's axes.",
            u32::from(quarters) * 90
        ),
        Mistake::MirroredX => mirrored("the x of the motion, or of the force, reversed"),
        Mistake::MirroredY => mirrored("the y of the motion, or of the force, reversed"),
        Mistake::Swapped => mirrored("x and y of the motion, or of the force, exchanged"),
        Mistake::Rise(rise) => format!(
            "If every acceleration is reached in {:.1} ms, steadily, a pose fits (`rise_seconds` of each segment); they were told \
             as steps.",
            rise * 1e3
        ),
        Mistake::Radius(radius) => format!(
            "With a finger of radius {:.2} mm a pose fits (--radius-mm): {:.2} mm was told.",
            radius * 1e3,
            known.radius * 1e3
        ),
        Mistake::Unit { of, factor } => {
            let (of, files) = match of {
                Lengths::OfPart => ("the part's lengths", "the part file"),
                Lengths::OfMotion => ("the motion's lengths", "the motion's file (on standard input they are in m)"),
                Lengths::OfBoth => ("the part's and the motion's lengths", "both files"),
            };
            format!("With {of} {} a pose fits: check `unit` in {files}.", times(factor))
        }
        Mistake::Friction(mu_g) => format!(
            "With mu = {:.3} a pose fits: the part file says {:.3}.",
            mu_g / GRAVITY_ASSUMED,
            known.mu_g / GRAVITY_ASSUMED
        ),
        Mistake::BiasDrift(drift) => format!(
            "If the reading without force drifts by some {:.0} mN/s during the push a pose fits: does it stay after the push, with the finger \
             free (`palpate diagnose`)? A gauge may come off, or a hand or a draught warm the beam; then tare and push again.",
            drift.norm() * 1e3
        ),
    }
}

fn mirrored(how: &str) -> String {
    format!("With {how} a pose fits: both must be told in the finger's axes, and the part as seen from above.")
}

/// A factor as people say it.
fn times(factor: f64) -> String {
    let rounded = |value: f64| (value * 100.0).round() / 100.0;
    if factor >= 1.0 {
        format!("{} times as long", rounded(factor))
    } else {
        format!("{} times shorter", rounded(factor.recip()))
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point2, Vector2};
    use palpate::geometry::SimplePolygon;
    use palpate::pushing::dynamics::Part;
    use palpate::pushing::estimation::from_rest::CarriedFinger;
    use palpate::pushing::estimation::from_rest::misfit::LikelyMistake;
    use palpate::pushing::finger_motion::{FingerMotion, Segment};

    use super::*;

    #[test]
    fn every_mistake_is_told_with_what_to_look_at() {
        let vertices = [[0.0, 0.0], [0.06, 0.0], [0.0, 0.04]].map(Point2::from).to_vec();
        let part = Part::uniform(SimplePolygon::new(vertices).unwrap());
        let ahead = Segment { seconds: 0.5, acceleration: Vector2::new(0.1, 0.0) };
        let motion = FingerMotion::new(Point2::origin(), &[ahead]).unwrap();
        let known = KnownFromRest {
            errors: None,
            part: &part,
            mu_g: 0.25 * GRAVITY_ASSUMED,
            mu_g_log_sd: None,
            radius: 0.015,
            shape: None,
            finger: CarriedFinger::RIGID,
            motion: &motion,
        };
        let told = |mistake: Option<Mistake>, onset_angle: f64| {
            let mistakes = mistake.into_iter().map(|mistake| LikelyMistake { mistake, cost: 1.0 }).collect();
            in_words(&known, &Misfit { onset_angle, mistakes }).replace('\n', " ")
        };
        let unit = |of, factor| Mistake::Unit { of, factor };
        for (mistake, wanted) in [
            (Mistake::Reversed, "not those on the part"),
            (Mistake::Turned { quarters: 3 }, "turned by 270°"),
            (Mistake::MirroredY, "the y of the motion"),
            (Mistake::Rise(0.0204), "is reached in 20.4 ms, steadily, a pose fits (`rise_seconds` of each segment)"),
            (Mistake::Radius(0.0082), "radius 8.20 mm a pose fits (--radius-mm): 15.00 mm was told"),
            (unit(Lengths::OfPart, 1e-3), "the part's lengths 1000 times shorter"),
            (unit(Lengths::OfMotion, 25.4), "25.4 times as long a pose fits: check `unit` in the motion's file"),
            (Mistake::BiasDrift(Vector2::new(3e-3, -4e-3)), "drifts by some 5 mN/s during the push a pose fits"),
            (Mistake::Friction(0.5 * GRAVITY_ASSUMED), "mu = 0.500 a pose fits: the part file says 0.250"),
        ] {
            let said = told(Some(mistake), 0.3);
            assert!(said.contains(wanted), "wanted {wanted}, got {said}");
        }
        assert!(told(None, 0.3).starts_with("None of the usual mistakes"));
        assert!(told(None, 3.0).starts_with("The first force on the finger is 172° away"));
    }
}

//! A sampling plan in a file: what `palpate sample --json` prints and `--decode` reads. JSON.
//!
//! It is the answer of `palpate solve` to the problem `point_sampling`, with names.

use palpate::point_sampling::{Decoded, Plan, PointReading, decode};
use serde::{Deserialize, Serialize};

use crate::solve::kinds::point_sampling::PointSamplingAnswer;

/// A plan with names.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanFile {
    /// What each outline is called; a plan from `palpate solve` has no names.
    #[serde(default)]
    pub names: Vec<String>,
    /// The plan itself, as `palpate solve` answers.
    #[serde(flatten)]
    pub answer: PointSamplingAnswer,
}

/// Why readings cannot be decoded.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DecodeError {
    /// A character that is no reading.
    #[error("`{character}` at place {place} is no reading: write 1 for covered, 0 for free, ? for unreadable")]
    Character {
        /// The character that stands there.
        character: char,
        /// Its place, from 1.
        place: usize,
    },
    /// Not one reading a point.
    #[error("there are {readings} readings and the plan has {points} points: give one for each, in order")]
    Count {
        /// How many were given.
        readings: usize,
        /// How many are needed.
        points: usize,
    },
}

impl PlanFile {
    /// A plan with names for its polygons.
    #[must_use]
    pub fn new(names: Vec<String>, plan: &Plan) -> Self {
        Self { names, answer: plan.into() }
    }

    /// What a polygon is called.
    #[must_use]
    pub fn name(&self, polygon: usize) -> String {
        self.names.get(polygon).cloned().unwrap_or_else(|| format!("polygon {polygon}"))
    }

    /// Which polygon it is, from readings as text: `1`, `0` and `?`; spaces count for nothing.
    ///
    /// # Errors
    /// [`DecodeError`].
    pub fn decode(&self, readings: &str) -> Result<Decoded, DecodeError> {
        let characters = readings.chars().filter(|character| !character.is_whitespace());
        let read = |(place, character): (usize, char)| {
            PointReading::from_char(character).ok_or(DecodeError::Character { character, place: place + 1 })
        };
        let readings: Vec<PointReading> = characters.enumerate().map(read).collect::<Result<_, _>>()?;
        let count = DecodeError::Count { readings: readings.len(), points: self.answer.points.len() };
        let signatures: Vec<Vec<bool>> =
            self.answer.signatures.iter().map(|signature| signature.iter().map(|&bit| bit != 0).collect()).collect();
        decode(&signatures, &readings).filter(|_| readings.len() == self.answer.points.len()).ok_or(count)
    }
}

/// What readings mean, in words.
#[must_use]
pub fn in_words(plan: &PlanFile, decoded: &Decoded) -> String {
    let names: Vec<String> = decoded.nearest.iter().map(|&polygon| plan.name(polygon)).collect();
    let misread = decoded.contradicted.first().map_or(0, Vec::len);
    let points = |list: &[usize]| list.iter().map(|point| (point + 1).to_string()).collect::<Vec<_>>().join(", ");
    match (names.as_slice(), misread) {
        ([one], 0) if decoded.margin > 1 && decoded.margin != usize::MAX => {
            format!("{one}, also if {} of the points were misread", decoded.margin.div_ceil(2) - 1)
                .replace(", also if 0 of the points were misread", "; a single misread point would show")
        }
        ([one], 0) => one.clone(),
        (several, 0) => format!("one of: {}", several.join("; ")),
        ([one], _) => {
            format!("{one}, if point {} was misread; nothing fits all readings", points(&decoded.contradicted[0]))
        }
        (several, count) => format!(
            "misread: nothing fits all readings, and {count} wrong would make it one of: {}",
            several.join("; ")
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solve::Problem;
    use crate::solve::kinds::point_sampling::PointSampling;

    fn plan(separation: usize) -> PlanFile {
        // Two bars across two others: three pieces of each are in no other.
        let bar = |[x, y]: [f64; 2], [w, h]: [f64; 2]| {
            format!("[[{x}, {y}], [{}, {y}], [{}, {}], [{x}, {}]]", x + w, x + w, y + h, y + h)
        };
        let (flat, upright) = ([6.0, 1.0], [1.0, 6.0]);
        let polygons =
            [bar([0.0, 1.0], flat), bar([0.0, 3.0], flat), bar([1.0, 0.0], upright), bar([3.0, 0.0], upright)];
        let line = format!("{{\"polygons\": [{}], \"separation\": {separation}}}", polygons.join(", "));
        let answer = serde_json::from_str::<PointSampling>(&line).unwrap().solve().unwrap();
        PlanFile { names: ["a", "b", "c", "d"].map(str::to_owned).into(), answer }
    }

    fn text(plan: &PlanFile, polygon: usize) -> String {
        plan.answer.signatures[polygon].iter().map(u8::to_string).collect()
    }

    #[test]
    fn every_signature_decodes_to_its_polygon() {
        let plan = plan(1);
        for polygon in 0..4 {
            let decoded = plan.decode(&text(&plan, polygon)).unwrap();
            assert_eq!(decoded.nearest, [polygon]);
            assert!(in_words(&plan, &decoded).starts_with(&plan.names[polygon]));
        }
        let nothing = plan.decode(&"?".repeat(plan.answer.points.len())).unwrap();
        assert_eq!(nothing.nearest, [0, 1, 2, 3]);
    }

    #[test]
    fn a_plan_for_one_misread_point_corrects_it() {
        let plan = plan(3);
        assert_eq!(plan.answer.pairs, Vec::<[usize; 2]>::new());
        for polygon in 0..4 {
            for wrong in 0..plan.answer.points.len() {
                let mut readings: Vec<char> = text(&plan, polygon).chars().collect();
                readings[wrong] = if readings[wrong] == '0' { '1' } else { '0' };
                let decoded = plan.decode(&readings.iter().collect::<String>()).unwrap();
                assert_eq!(
                    (decoded.nearest.as_slice(), decoded.contradicted[0].as_slice()),
                    (&[polygon][..], &[wrong][..])
                );
                assert!(in_words(&plan, &decoded).contains("misread"));
            }
        }
    }

    #[test]
    fn wrong_readings_are_named() {
        let plan = plan(1);
        assert_eq!(plan.decode("0x"), Err(DecodeError::Character { character: 'x', place: 2 }));
        let told = plan.decode("0").unwrap_err().to_string();
        assert!(told.contains("1 readings") && told.contains("2 points"), "{told}");
    }
}

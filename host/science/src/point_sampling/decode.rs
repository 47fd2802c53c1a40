//! Which polygon it is, from what the points read.

/// What a point reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointReading {
    /// The point is covered by the part.
    Covered,
    /// The point is free of the part.
    Free,
    /// Nothing can be told.
    Unreadable,
}

impl PointReading {
    /// From the characters `1`, `0` and `?`.
    #[must_use]
    pub fn from_char(character: char) -> Option<Self> {
        match character {
            '1' => Some(Self::Covered),
            '0' => Some(Self::Free),
            '?' => Some(Self::Unreadable),
            _ => None,
        }
    }

    fn contradicts(self, covered: bool) -> bool {
        match self {
            Self::Covered => !covered,
            Self::Free => covered,
            Self::Unreadable => false,
        }
    }
}

/// What readings say about which polygon is there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Decoded {
    /// The polygons that contradict the fewest readings.
    pub nearest: Vec<usize>,
    /// The points whose readings each of them contradicts.
    pub contradicted: Vec<Vec<usize>>,
    /// By how many readable points the next best or an equal one contradicts more than the best: while fewer are
    /// misread than that, less what is contradicted already, the answer stands.
    pub margin: usize,
}

/// Finds the polygons that fit readings best; none if the number of readings is not that of the points.
///
/// ```
/// use palpate::point_sampling::{PointReading, decode};
///
/// let signatures = [vec![false, false, true], vec![false, true, true], vec![true, true, false]];
/// let readings: Vec<_> = "01?".chars().filter_map(PointReading::from_char).collect();
/// let decoded = decode(&signatures, &readings).unwrap();
/// assert_eq!(decoded.nearest, [1]);
/// ```
#[must_use]
pub fn decode(signatures: &[Vec<bool>], readings: &[PointReading]) -> Option<Decoded> {
    if signatures.iter().any(|signature| signature.len() != readings.len()) {
        return None;
    }
    let contradicted = |signature: &Vec<bool>| -> Vec<usize> {
        let pairs = readings.iter().zip(signature).enumerate();
        pairs.filter(|(_, (reading, covered))| reading.contradicts(**covered)).map(|(point, _)| point).collect()
    };
    let all: Vec<Vec<usize>> = signatures.iter().map(contradicted).collect();
    let least = all.iter().map(Vec::len).min()?;
    let nearest: Vec<usize> = (0..all.len()).filter(|&polygon| all[polygon].len() == least).collect();
    let mut counts: Vec<usize> = all.iter().map(Vec::len).collect();
    counts.sort_unstable();
    let margin = counts.get(1).map_or(usize::MAX, |next| next - least);
    Some(Decoded { contradicted: nearest.iter().map(|&polygon| all[polygon].clone()).collect(), nearest, margin })
}

//! The lines between a host and whatever moves the finger; `docs/ROBOT.md` is for who writes the other end.
//!
//! ```text
//! move X Y SPEED     go straight to a place            m, m/s
//! stop               brake and stay
//! where              tell the place at once
//! T X Y              where the finger is               s, m      (from the robot, also unasked)
//! error WORDS        what the robot cannot do                    (from the robot)
//! ```
//!
//! Lines end with a line feed; fields are divided by blanks; numbers are decimal. Frames: the robot's, whose axes are those
//! of the finger. Errors: [`RobotLineError`] shows the line.

use std::fmt;

use nalgebra::Point2;

/// Longest line in bytes: three numbers with all their digits, or a sentence.
pub const LINE_BYTES_MAX: usize = 200;

/// What a robot is told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RobotOrder {
    /// Go straight to a place.
    Move {
        /// m.
        to: Point2<f64>,
        /// m/s, above 0.
        speed: f64,
    },
    /// Brake and stay.
    Stop,
    /// Tell the place.
    Where,
}

/// What a robot says.
#[derive(Clone, Debug, PartialEq)]
pub enum RobotLine {
    /// Where it is.
    Place(RobotPlace),
    /// What it cannot do.
    Error(String),
}

/// Where a robot is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RobotPlace {
    /// By the robot's own clock, s.
    pub t: f64,
    /// Of the disk's centre without force, m.
    pub at: Point2<f64>,
}

/// A line that is none of the protocol's.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{line}` is no line of a robot: {reason}")]
pub struct RobotLineError {
    /// As it came.
    pub line: String,
    /// What is wrong with it.
    pub reason: &'static str,
}

fn wrong(line: &str, reason: &'static str) -> RobotLineError {
    RobotLineError { line: printable(line).chars().take(LINE_BYTES_MAX).collect(), reason }
}

/// Without what would move a terminal's cursor or colour its text.
fn printable(text: &str) -> String {
    text.chars().map(|each| if each.is_control() { char::REPLACEMENT_CHARACTER } else { each }).collect()
}

/// As many numbers as asked for.
fn numbers<const N: usize>(line: &str, words: &[&str]) -> Result<[f64; N], RobotLineError> {
    let words: [&str; N] = words.try_into().map_err(|_| wrong(line, "it has too many or too few numbers"))?;
    let mut numbers = [0.0; N];
    for (number, word) in numbers.iter_mut().zip(words) {
        let parsed = word.parse().ok().filter(|value: &f64| value.is_finite());
        *number = parsed.ok_or_else(|| wrong(line, "a field is not a number"))?;
    }
    Ok(numbers)
}

impl RobotLine {
    /// Reads a line.
    ///
    /// # Errors
    /// [`RobotLineError`].
    pub fn parse(line: &str) -> Result<Self, RobotLineError> {
        let words: Vec<_> = line.split_ascii_whitespace().collect();
        if words.first() == Some(&"error") {
            return Ok(Self::Error(printable(&words[1..].join(" "))));
        }
        let [t, x, y] = numbers(line, &words)?;
        Ok(Self::Place(RobotPlace { t, at: Point2::new(x, y) }))
    }
}

impl RobotOrder {
    /// Reads a line, as a robot does.
    ///
    /// # Errors
    /// [`RobotLineError`].
    pub fn parse(line: &str) -> Result<Self, RobotLineError> {
        let words: Vec<_> = line.split_ascii_whitespace().collect();
        match words.as_slice() {
            ["stop"] => Ok(Self::Stop),
            ["where"] => Ok(Self::Where),
            ["move", rest @ ..] => {
                let [x, y, speed] = numbers(line, rest)?;
                let order = Self::Move { to: Point2::new(x, y), speed };
                if speed > 0.0 { Ok(order) } else { Err(wrong(line, "the speed must be above 0")) }
            }
            _ => Err(wrong(line, "it is neither `move X Y SPEED` nor `stop` nor `where`")),
        }
    }
}

impl fmt::Display for RobotOrder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Move { to, speed } => write!(f, "move {:.6} {:.6} {:.6}", to.x, to.y, speed),
            Self::Stop => f.write_str("stop"),
            Self::Where => f.write_str("where"),
        }
    }
}

impl fmt::Display for RobotPlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.6} {:.7} {:.7}", self.t, self.at.x, self.at.y)
    }
}

/// Bytes to lines. A line that is too long is dropped as a whole.
#[derive(Clone, Debug, Default)]
pub struct LineCutter {
    begun: Vec<u8>,
    is_too_long: bool,
}

impl LineCutter {
    /// What has come of a line that has not ended, as one that does not.
    pub(super) fn begun(&self) -> Option<RobotLineError> {
        let text = String::from_utf8_lossy(&self.begun);
        (!self.begun.is_empty()).then(|| wrong(text.trim(), "no line feed ends it"))
    }

    /// Takes bytes; hands on each line that they end.
    pub fn take(&mut self, bytes: &[u8], mut line: impl FnMut(Result<&str, RobotLineError>)) {
        for &byte in bytes {
            if byte != b'\n' {
                if self.begun.len() < LINE_BYTES_MAX {
                    self.begun.push(byte);
                } else {
                    self.is_too_long = true;
                }
                continue;
            }
            let begun = std::mem::take(&mut self.begun);
            let text = String::from_utf8_lossy(&begun);
            let text = text.trim();
            if std::mem::take(&mut self.is_too_long) {
                line(Err(wrong(text, "it is longer than 200 bytes")));
            } else if !text.is_empty() {
                line(Ok(text));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn orders_and_places_are_read_as_they_are_written(x in -2.0..2.0_f64, y in -2.0..2.0_f64, v in 1e-4..1.0_f64) {
            let Ok(RobotOrder::Move { to, speed }) = RobotOrder::parse(&RobotOrder::Move { to: Point2::new(x, y), speed: v }.to_string()) else {
                return Err(TestCaseError::fail("not read"));
            };
            // A micrometre, as written.
            prop_assert!((to - Point2::new(x, y)).amax() <= 5.1e-7 && (speed - v).abs() <= 5.1e-7);
            let Ok(RobotLine::Place(place)) = RobotLine::parse(&RobotPlace { t: v, at: Point2::new(x, y) }.to_string()) else {
                return Err(TestCaseError::fail("not read"));
            };
            prop_assert!((place.at - Point2::new(x, y)).amax() <= 5.1e-8);
        }

        #[test]
        fn any_bytes_in_any_pieces_are_the_same_lines(bytes in proptest::collection::vec(prop_oneof![Just(b'\n'), any::<u8>()], 0..600), cut in 0_usize..600) {
            let lines = |pieces: &[&[u8]]| {
                let (mut cutter, mut lines) = (LineCutter::default(), Vec::new());
                for piece in pieces {
                    cutter.take(piece, |line| lines.push(line.map(str::to_owned)));
                }
                lines
            };
            let cut = cut.min(bytes.len());
            prop_assert_eq!(lines(&[&bytes]), lines(&[&bytes[..cut], &bytes[cut..]]));
        }
    }

    #[test]
    fn what_is_no_line_says_why() {
        for (line, word) in
            [("move 1 2", "few"), ("move 1 2 x", "number"), ("move 0 0 0", "above 0"), ("go", "neither")]
        {
            let error = RobotOrder::parse(line).unwrap_err().to_string();
            assert!(error.contains(word) && error.contains(line), "{error}");
        }
        assert_eq!(RobotLine::parse("error arm is off"), Ok(RobotLine::Error("arm is off".to_owned())));
        for line in ["1 2", "1 2 3 4", "1 2 nan", "1 inf 2"] {
            assert!(RobotLine::parse(line).is_err(), "{line}");
        }
        let mut lines = Vec::new();
        LineCutter::default().take(&[b'1'; 300], |_| panic!("no line ended"));
        LineCutter::default().take(&[&[b'1'; 300][..], b"\nstop\n"].concat(), |line| lines.push(line.is_ok()));
        assert_eq!(lines, [false, true]);
    }
}

//! Switches that change: a line `T ID 0|1` for each change, as a controller's inputs tell it, and what they show once they have settled.
//!
//! `T` is a time in seconds on any clock that does not go back, `ID` the number of the point, from 1, as a plan counts them.
//! Contacts bounce: readings count once none has changed for a while ([`Settling`]). Units: s. Errors: [`BitError`].

/// A switch that changed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BitChange {
    /// When, s.
    pub t: f64,
    /// Which, from 0.
    pub point: usize,
    /// Whether it is covered now.
    pub covered: bool,
}

/// Why a line is no change of a switch.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BitError {
    /// Not three words.
    #[error("`{line}` is not `T ID 0|1`: a time in seconds, the point's number and its reading")]
    Words {
        /// The line.
        line: String,
    },
    /// No time.
    #[error("`{word}` is no time in seconds")]
    Time {
        /// What stands there.
        word: String,
    },
    /// No switch.
    #[error("`{word}` is no switch: they are numbered from 1 to {points}")]
    Point {
        /// What stands there.
        word: String,
        /// How many there are.
        points: usize,
    },
    /// Neither covered nor free.
    #[error("`{word}` is no reading: write 1 for covered, 0 for free")]
    Reading {
        /// What stands there.
        word: String,
    },
    /// Earlier than the line before.
    #[error("the time {t} s is before {before} s, that of the line before")]
    Back {
        /// Of this line, s.
        t: f64,
        /// Of the line before, s.
        before: f64,
    },
}

impl BitChange {
    /// A line, of so many switches. An empty one, or one that begins with `#`, is none.
    ///
    /// # Errors
    /// [`BitError`].
    pub fn parse(line: &str, points: usize) -> Result<Option<Self>, BitError> {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            return Ok(None);
        }
        let words: Vec<&str> = line.split_whitespace().collect();
        let [t, id, reading] = words[..] else { return Err(BitError::Words { line: line.to_owned() }) };
        let time = t.parse().ok().filter(|t: &f64| t.is_finite());
        let t = time.ok_or_else(|| BitError::Time { word: t.to_owned() })?;
        let number = id.parse().ok().filter(|number| (1..=points).contains(number));
        let number: usize = number.ok_or_else(|| BitError::Point { word: id.to_owned(), points })?;
        let covered = match reading {
            "0" => false,
            "1" => true,
            word => return Err(BitError::Reading { word: word.to_owned() }),
        };
        Ok(Some(Self { t, point: number - 1, covered }))
    }
}

/// Readings that have settled.
#[derive(Clone, Debug, PartialEq)]
pub struct Settled {
    /// When the last of them changed, s.
    pub t: f64,
    /// Of each point, as [`super::sampling_plan::PlanFile::decode`] takes them: `1`, `0`, and `?` where it has told nothing yet.
    pub readings: String,
}

/// Waits until no switch has changed for a while.
#[derive(Clone, Debug)]
pub struct Settling {
    debounce: f64,
    readings: Vec<char>,
    /// What was told last.
    told: Option<String>,
    changed: Option<f64>,
    last: Option<f64>,
}

impl Settling {
    /// Of so many points, for so long, s.
    #[must_use]
    pub fn new(points: usize, debounce: f64) -> Self {
        Self { debounce, readings: vec!['?'; points], told: None, changed: None, last: None }
    }

    /// Takes a change; the readings before it, where they had settled and differ from those told last.
    ///
    /// # Errors
    /// [`BitError::Back`]; the change then counts for nothing.
    pub fn take(&mut self, change: &BitChange) -> Result<Option<Settled>, BitError> {
        if let Some(before) = self.last.filter(|last| *last > change.t) {
            return Err(BitError::Back { t: change.t, before });
        }
        self.last = Some(change.t);
        let settled = self.until(change.t);
        let reading = if change.covered { '1' } else { '0' };
        if self.readings[change.point] != reading {
            self.readings[change.point] = reading;
            self.changed = Some(change.t);
        }
        Ok(settled)
    }

    /// Nothing changed until this time, s: the readings, where they have settled and differ from those told last.
    pub fn until(&mut self, time: f64) -> Option<Settled> {
        if self.changed.is_some_and(|changed| time - changed >= self.debounce) { self.settle() } else { None }
    }

    /// The readings, once nothing more comes or nothing came for that long.
    pub fn settle(&mut self) -> Option<Settled> {
        let t = self.changed.take()?;
        let readings: String = self.readings.iter().collect();
        if self.told.as_ref() == Some(&readings) {
            return None;
        }
        self.told = Some(readings.clone());
        Some(Settled { t, readings })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DEBOUNCE: f64 = 0.02;

    fn told(lines: &str, points: usize) -> Vec<(f64, String)> {
        let mut settling = Settling::new(points, DEBOUNCE);
        let mut told = Vec::new();
        for line in lines.lines() {
            let Some(change) = BitChange::parse(line, points).unwrap() else { continue };
            told.extend(settling.take(&change).unwrap());
        }
        told.extend(settling.settle());
        told.into_iter().map(|settled| (settled.t, settled.readings)).collect()
    }

    #[test]
    fn bounces_are_one_change_and_what_is_as_before_is_not_told_again() {
        let lines = "# at rest\n0 1 0\n0 2 0\n\n1.000 1 1\n1.001 1 0\n1.003 1 1\n1.010 2 1\n2 2 0\n2.005 2 1\n3 1 0\n";
        let told = told(lines, 2);
        let expected = [(0.0, "00"), (1.01, "11"), (3.0, "01")].map(|(t, text)| (t, text.to_owned()));
        assert_eq!(told, expected);
    }

    #[test]
    fn a_switch_that_told_nothing_is_unknown() {
        assert_eq!(told("0 2 1\n", 3), [(0.0, "?1?".to_owned())]);
    }

    #[test]
    fn wrong_lines_are_named() {
        let why = |line| BitChange::parse(line, 3).unwrap_err().to_string();
        assert!(why("1 2").contains("T ID 0|1"));
        assert!(why("x 2 1").contains("`x` is no time") && why("nan 2 1").contains("no time"));
        assert!(why("1 4 1").contains("from 1 to 3") && why("1 0 1").contains("`0` is no switch"));
        assert!(why("1 2 on").contains("`on` is no reading"));
        let mut settling = Settling::new(1, DEBOUNCE);
        settling.take(&BitChange { t: 2.0, point: 0, covered: true }).unwrap();
        let back = settling.take(&BitChange { t: 1.0, point: 0, covered: false }).unwrap_err();
        assert!(back.to_string().contains("1 s is before 2 s"), "{back}");
    }
}

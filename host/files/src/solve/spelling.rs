//! "Did you mean …?" for names of kinds and fields.

use strsim::osa_distance;

/// Longer names than this are not compared: nobody mistypes one of ours into them.
const LENGTH_MAX: usize = 40;

/// The candidate nearest to a misspelt word, if one is near enough to be meant: a third of the letters at most differ.
///
/// Letters are inserted, deleted, replaced or swapped with their neighbour, none changed twice (`strsim`'s optimal
/// string alignment, which is in the program already for the command line's suggestions).
pub(crate) fn nearest<'a>(word: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let letters = word.chars().take(LENGTH_MAX + 1).count();
    if letters > LENGTH_MAX {
        return None;
    }
    let by_distance = candidates.into_iter().map(|candidate| (osa_distance(word, candidate), candidate));
    let (distance, candidate) = by_distance.min()?;
    (distance <= (letters / 3).max(1)).then_some(candidate)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slip_of_the_finger_is_recognised_and_another_word_is_not() {
        let kinds = ["push", "roll", "observe_push", "observe_roll"];
        assert_eq!(nearest("pusch", kinds), Some("push"));
        assert_eq!(nearest("psuh", kinds), Some("push"), "two letters swapped are one slip");
        assert_eq!(nearest("observepush", kinds), Some("observe_push"));
        assert_eq!(nearest("teleport", kinds), None);
        assert_eq!(nearest("", kinds), None);
        assert_eq!(nearest(&"push".repeat(1000), kinds), None);
    }
}

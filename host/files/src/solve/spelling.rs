//! "Did you mean …?" for names of kinds and fields.

/// Longer names than this are not compared: nobody mistypes one of ours into them.
const LENGTH_MAX: usize = 40;

/// The candidate nearest to a misspelt word, if one is near enough to be meant: a third of the letters at most differ.
pub(crate) fn nearest<'a>(word: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let letters: Vec<char> = word.chars().take(LENGTH_MAX + 1).collect();
    if letters.len() > LENGTH_MAX {
        return None;
    }
    let by_distance = candidates.into_iter().map(|candidate| (distance(&letters, candidate), candidate));
    let (distance, candidate) = by_distance.min()?;
    (distance <= (letters.len() / 3).max(1)).then_some(candidate)
}

/// Letters to insert, delete, replace or swap with their neighbour to make one word of the other (Damerau and Levenshtein's
/// distance, no letter changed twice).
fn distance(word: &[char], other: &str) -> usize {
    let other: Vec<char> = other.chars().collect();
    let mut table = vec![vec![0; other.len() + 1]; word.len() + 1];
    for i in 0..=word.len() {
        for j in 0..=other.len() {
            table[i][j] = match (i, j) {
                (0, _) | (_, 0) => i + j,
                _ => {
                    let replaced = table[i - 1][j - 1] + usize::from(word[i - 1] != other[j - 1]);
                    replaced.min(table[i - 1][j] + 1).min(table[i][j - 1] + 1)
                }
            };
            if i > 1 && j > 1 && word[i - 1] == other[j - 2] && word[i - 2] == other[j - 1] {
                table[i][j] = table[i][j].min(table[i - 2][j - 2] + 1);
            }
        }
    }
    table[word.len()][other.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slip_of_the_finger_is_recognised_and_another_word_is_not() {
        let kinds = ["push", "roll", "observe_push", "observe_roll"];
        assert_eq!(nearest("pusch", kinds), Some("push"));
        assert_eq!(nearest("observepush", kinds), Some("observe_push"));
        assert_eq!(nearest("teleport", kinds), None);
        assert_eq!(nearest("", kinds), None);
        assert_eq!(nearest(&"push".repeat(1000), kinds), None);
    }

    #[test]
    fn distances_are_those_of_the_textbook() {
        let of = |a: &str, b: &str| distance(&a.chars().collect::<Vec<_>>(), b);
        assert_eq!(of("kitten", "sitting"), 3);
        assert_eq!(of("area", "aera"), 1);
        assert_eq!(of("", "abc"), 3);
        assert_eq!(of("abc", ""), 3);
    }
}

//! Text for terminals: nothing wider than the narrowest one that is still common.
//!
//! Units: columns, one a character. Errors: none; a word that is wider stands on a line of its own.

/// Columns of the narrowest terminal that is still common, and of most new windows.
pub(crate) const COLUMNS: usize = 80;

/// Prose with its lines broken between words. Breaks that are there stay, and what goes on begins under its beginning.
pub(crate) fn folded(text: &str) -> String {
    folded_to(text, COLUMNS)
}

/// The same for another width.
pub(crate) fn folded_to(text: &str, columns: usize) -> String {
    text.lines().map(|line| fold_line(line, columns)).collect::<Vec<_>>().join("\n")
}

fn fold_line(line: &str, columns: usize) -> String {
    let indent = line.chars().take_while(|c| *c == ' ').count();
    let margin = " ".repeat(indent);
    let (mut text, mut width) = (margin.clone(), indent);
    for word in line.split(' ').filter(|word| !word.is_empty()) {
        let length = word.chars().count();
        if width > indent && width + 1 + length > columns {
            text = text + "\n" + &margin;
            width = indent;
        }
        if width > indent {
            text.push(' ');
            width += 1;
        }
        text.push_str(word);
        width += length;
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prose_breaks_between_words_before_the_margin() {
        let word = "twelve chars".replace(' ', "_");
        let text = [word.as_str(); 13].join(" ");
        let lines: Vec<_> = folded(&text).lines().map(str::to_owned).collect();
        assert_eq!(lines.len(), 3, "{lines:?}");
        assert!(lines.iter().all(|line| line.chars().count() <= COLUMNS), "{lines:?}");
        assert_eq!(lines.join(" "), text);
    }

    #[test]
    fn breaks_and_indents_that_are_there_stay() {
        assert_eq!(folded("one\n  two three\n\nfour"), "one\n  two three\n\nfour");
        let long = format!("  {}", ["word"; 20].join(" "));
        assert!(folded(&long).lines().all(|line| line.starts_with("  word") && line.chars().count() <= COLUMNS));
        let wide = "°".repeat(COLUMNS);
        assert_eq!(folded(&wide), wide, "columns are characters, not bytes");
    }
}

//! The texts that stand below the options in a command's help.

/// A text for people at terminals of any width.
///
/// Lines that are indented stand as they are: files, command lines, tables. All others are prose, however they are
/// broken in the source: up to a blank or an indented line they are one paragraph, which clap breaks where the
/// terminal ends.
pub(super) fn flowing(text: &str) -> String {
    let is_prose = |line: &str| !line.is_empty() && !line.starts_with(' ');
    let mut lines = text.lines().peekable();
    let mut flowed = String::new();
    while let Some(line) = lines.next() {
        flowed.push_str(line);
        if let Some(next) = lines.peek() {
            flowed.push(if is_prose(line) && is_prose(next) { ' ' } else { '\n' });
        }
    }
    flowed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prose_is_one_line_a_paragraph_and_what_is_indented_stands() {
        let text = "A file is\nTOML:\n  a = 1\n  b = 2\nBoth are\nneeded.\n\nExit\nstatus: 0.";
        assert_eq!(flowing(text), "A file is TOML:\n  a = 1\n  b = 2\nBoth are needed.\n\nExit status: 0.");
    }
}

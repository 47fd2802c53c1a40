//! Bytes to lines, with flat memory whatever the bytes are.

use std::io::{self, BufRead, Read};

/// Longest line read, in bytes. A minute of contacts at 4 kHz takes 5 MB.
pub(super) const LINE_BYTES_MAX: usize = 64 << 20;

/// Room behind a line that is not worth giving back, in bytes.
const ROOM_MAX: usize = 4096;

const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// A line that is not blank.
#[derive(Debug, PartialEq)]
pub(super) struct Line {
    /// Its place in the input, from 1, blank lines counted.
    pub number: u64,
    /// What it holds.
    pub content: Content,
}

/// What a line holds.
#[derive(Debug, PartialEq)]
pub(super) enum Content {
    /// Its bytes without the line end.
    Bytes(Vec<u8>),
    /// More than [`LINE_BYTES_MAX`], left unread.
    TooLong,
}

impl Content {
    /// Bytes held in memory.
    pub(super) fn size(&self) -> usize {
        match self {
            Self::Bytes(bytes) => bytes.len(),
            Self::TooLong => 0,
        }
    }
}

/// The lines of an input that are not blank.
pub(super) struct Lines<R> {
    input: R,
    number: u64,
    bytes_max: usize,
}

impl<R: BufRead> Lines<R> {
    pub(super) fn new(input: R) -> Self {
        Self { input, number: 0, bytes_max: LINE_BYTES_MAX }
    }

    /// Reads on to the end of one line. `None` at the end of the input.
    fn read_line(&mut self) -> io::Result<Option<Content>> {
        let mut bytes = Vec::new();
        let limit = u64::try_from(self.bytes_max).unwrap_or(u64::MAX).saturating_add(1);
        if self.input.by_ref().take(limit).read_until(b'\n', &mut bytes)? == 0 {
            return Ok(None);
        }
        self.number += 1;
        if bytes.last() == Some(&b'\n') {
            bytes.pop();
        } else if bytes.len() > self.bytes_max {
            self.input.skip_until(b'\n')?;
            return Ok(Some(Content::TooLong));
        }
        if self.number == 1 && bytes.starts_with(BYTE_ORDER_MARK) {
            bytes.drain(..BYTE_ORDER_MARK.len());
        }
        if bytes.last() == Some(&b'\r') {
            bytes.pop();
        }
        // It may wait for long: what is read ahead is counted by its length.
        if bytes.capacity() - bytes.len() > ROOM_MAX {
            bytes.shrink_to_fit();
        }
        Ok(Some(Content::Bytes(bytes)))
    }
}

fn is_blank(content: &Content) -> bool {
    matches!(content, Content::Bytes(bytes) if bytes.iter().all(|byte| matches!(byte, b' ' | b'\t' | b'\r')))
}

impl<R: BufRead> Iterator for Lines<R> {
    type Item = io::Result<Line>;

    fn next(&mut self) -> Option<io::Result<Line>> {
        loop {
            match self.read_line().transpose()? {
                Ok(content) if is_blank(&content) => {}
                other => return Some(other.map(|content| Line { number: self.number, content })),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(bytes: &[u8], bytes_max: usize) -> Vec<(u64, Option<String>)> {
        let lines = Lines { bytes_max, ..Lines::new(bytes) };
        let shown = |Line { number, content }| match content {
            Content::Bytes(bytes) => (number, Some(String::from_utf8(bytes).unwrap())),
            Content::TooLong => (number, None),
        };
        lines.map(|line| shown(line.unwrap())).collect()
    }

    fn line(number: u64, text: &str) -> (u64, Option<String>) {
        (number, Some(text.to_owned()))
    }

    #[test]
    fn line_ends_blank_lines_and_the_byte_order_mark_are_no_content() {
        assert_eq!(lines(b"\xef\xbb\xbfa\r\n\n \t\r\nb\n\r\nc", 99), [line(1, "a"), line(4, "b"), line(6, "c")]);
        assert_eq!(lines(b"", 99), []);
        assert_eq!(lines(b"\xef\xbb\xbf\n", 99), []);
        assert_eq!(lines(b"a\n\xef\xbb\xbfb\n", 99), [line(1, "a"), line(2, "\u{feff}b")]);
    }

    #[test]
    fn a_line_beyond_the_limit_is_left_out_and_the_next_is_read() {
        assert_eq!(
            lines(b"1234\n12345\n123456\n12\n", 5),
            [line(1, "1234"), line(2, "12345"), (3, None), line(4, "12")]
        );
        assert_eq!(lines(b"123456", 5), [(1, None)]);
        assert_eq!(lines(b"12345", 5), [line(1, "12345")]);
    }
}

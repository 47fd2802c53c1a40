//! Bytes to lines, with flat memory whatever the bytes are: an input may go on for ever, and so may a line of it.

use std::io::{self, BufRead, Read};

/// Longest line that a person or a robot's program writes, in bytes: ten thousand times what a contact, a segment or an
/// order needs.
pub const TEXT_BYTES_MAX: usize = 1 << 20;

/// Room behind a line that is not worth giving back, in bytes.
const ROOM_MAX: usize = 4096;

const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// A line.
#[derive(Debug, PartialEq, Eq)]
pub struct Line {
    /// Its place in the input, from 1.
    pub number: u64,
    /// What it holds.
    pub content: Content,
}

/// What a line holds.
#[derive(Debug, PartialEq, Eq)]
pub enum Content {
    /// Its bytes without the line end, and without the byte-order mark that some programs write before the first.
    Bytes(Vec<u8>),
    /// More than a line may hold, in bytes; left unread.
    TooLong {
        /// What it may hold.
        bytes_max: usize,
    },
}

/// Why nobody can use a line as text.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unusable {
    /// It was left unread.
    #[error("it is longer than {} MiB", bytes_max >> 20)]
    TooLong {
        /// What it may hold, in bytes.
        bytes_max: usize,
    },
    /// Its bytes are no characters.
    #[error("it is no text (UTF-8)")]
    NoText,
}

impl Content {
    /// Bytes held in memory.
    pub(crate) fn size(&self) -> usize {
        match self {
            Self::Bytes(bytes) => bytes.len(),
            Self::TooLong { .. } => 0,
        }
    }

    /// Whether it is white space alone.
    #[must_use]
    pub fn is_blank(&self) -> bool {
        matches!(self, Self::Bytes(bytes) if bytes.iter().all(|byte| matches!(byte, b' ' | b'\t' | b'\r')))
    }

    /// Its text.
    ///
    /// # Errors
    /// [`Unusable`] if it has none.
    pub fn into_text(self) -> Result<String, Unusable> {
        match self {
            Self::Bytes(bytes) => String::from_utf8(bytes).map_err(|_| Unusable::NoText),
            Self::TooLong { bytes_max } => Err(Unusable::TooLong { bytes_max }),
        }
    }
}

/// The lines of an input; they end where it ends, or behind the first that cannot be read.
///
/// ```
/// use palpate_files::lines::{Content, Lines, Unusable};
///
/// let mut lines = Lines::new(&b"{\"t\": 0}\r\n12345678901234567890\nlast"[..], 8).map(|line| line.unwrap().content);
/// assert_eq!(lines.next().map(Content::into_text), Some(Ok("{\"t\": 0}".to_owned())));
/// assert_eq!(lines.next().map(Content::into_text), Some(Err(Unusable::TooLong { bytes_max: 8 })));
/// assert_eq!(lines.next().map(Content::into_text), Some(Ok("last".to_owned())));
/// assert_eq!(lines.next(), None);
/// ```
#[derive(Debug)]
pub struct Lines<R> {
    input: R,
    number: u64,
    bytes_max: usize,
    ended: bool,
}

impl<R: BufRead> Lines<R> {
    /// The lines of `input`, none longer than `bytes_max`.
    pub const fn new(input: R, bytes_max: usize) -> Self {
        Self { input, number: 0, bytes_max, ended: false }
    }

    /// Reads on to the end of one line. `None` at the end of the input.
    fn read_line(&mut self) -> io::Result<Option<Content>> {
        let mut bytes = Vec::new();
        // Its end may be of two bytes.
        let limit = u64::try_from(self.bytes_max).unwrap_or(u64::MAX).saturating_add(2);
        if self.input.by_ref().take(limit).read_until(b'\n', &mut bytes)? == 0 {
            return Ok(None);
        }
        self.number += 1;
        let is_whole = bytes.pop_if(|byte| *byte == b'\n').is_some();
        if !is_whole && bytes.len() > self.bytes_max {
            self.input.skip_until(b'\n')?;
        }
        bytes.pop_if(|byte| *byte == b'\r');
        if bytes.len() > self.bytes_max {
            return Ok(Some(Content::TooLong { bytes_max: self.bytes_max }));
        }
        if self.number == 1 && bytes.starts_with(BYTE_ORDER_MARK) {
            bytes.drain(..BYTE_ORDER_MARK.len());
        }
        // It may wait for long: what is read ahead is counted by its length.
        if bytes.capacity() - bytes.len() > ROOM_MAX {
            bytes.shrink_to_fit();
        }
        Ok(Some(Content::Bytes(bytes)))
    }
}

impl<R: BufRead> Iterator for Lines<R> {
    type Item = io::Result<Line>;

    fn next(&mut self) -> Option<io::Result<Line>> {
        if self.ended {
            return None;
        }
        let read = self.read_line().transpose();
        self.ended = !matches!(read, Some(Ok(_)));
        Some(read?.map(|content| Line { number: self.number, content }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The lines that are not blank.
    fn lines(bytes: &[u8], bytes_max: usize) -> Vec<(u64, Option<String>)> {
        let lines = Lines::new(bytes, bytes_max).map(Result::unwrap).filter(|line| !line.content.is_blank());
        lines.map(|Line { number, content }| (number, content.into_text().ok())).collect()
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
        // Whatever ends it.
        assert_eq!(lines(b"12345\r\n123456\r\n1234567\r\n1234567890\r\n1\r\n", 5)[0], line(1, "12345"));
        assert_eq!(lines(b"123456\r\n1234567\r\n1234567890\r\n1\r\n", 5)[3], line(4, "1"));
    }

    #[test]
    fn what_is_no_text_says_why_and_the_next_line_is_read() {
        let long = "x".repeat(3 << 20);
        let most = "y".repeat(TEXT_BYTES_MAX);
        let input = [format!("one\r\n{long}\n{most}\n\n").as_bytes(), b"\xff\nlast"].concat();
        let read = Lines::new(input.as_slice(), TEXT_BYTES_MAX).map(|line| line.unwrap().content.into_text());
        let read: Vec<_> = read.map(|text| text.map_err(|why| why.to_string())).collect();
        let wanted = [
            Ok("one".to_owned()),
            Err("it is longer than 1 MiB".to_owned()),
            Ok(most),
            Ok(String::new()),
            Err("it is no text (UTF-8)".to_owned()),
            Ok("last".to_owned()),
        ];
        assert!(read == wanted, "{:?}", read.iter().map(|text| text.as_ref().map(String::len)).collect::<Vec<_>>());
    }

    #[test]
    fn they_end_where_the_input_cannot_be_read() {
        /// A disk that fails for ever.
        struct Broken;

        impl Read for Broken {
            fn read(&mut self, _: &mut [u8]) -> io::Result<usize> {
                Err(io::Error::other("broken"))
            }
        }

        let input = b"one\n".chain(Broken);
        let read: Vec<_> = Lines::new(io::BufReader::new(input), 99).map(|line| line.is_ok()).collect();
        assert_eq!(read, [true, false]);
    }
}

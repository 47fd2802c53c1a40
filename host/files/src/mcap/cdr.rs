//! Messages as ROS 2 has them on the wire: CDR, each number at a multiple of its own size.
//!
//! [`Cdr`] builds little-endian messages, [`CdrFields`] takes messages of either byte order apart.

/// Builds a message.
#[derive(Clone, Debug)]
pub struct Cdr(Vec<u8>);

/// Says that little-endian plain CDR follows.
const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

/// Room for most messages, so that they need not move as they grow, bytes.
const ROOM: usize = 128;

impl Default for Cdr {
    fn default() -> Self {
        Self::new()
    }
}

impl Cdr {
    /// An empty message.
    #[must_use]
    pub fn new() -> Self {
        let mut bytes = Vec::with_capacity(ROOM);
        bytes.extend_from_slice(&ENCAPSULATION);
        Self(bytes)
    }

    /// Places count from behind the encapsulation.
    fn aligned(mut self, size: usize) -> Self {
        while !(self.0.len() - ENCAPSULATION.len()).is_multiple_of(size) {
            self.0.push(0);
        }
        self
    }

    fn number<const N: usize>(self, bytes: [u8; N]) -> Self {
        let mut aligned = self.aligned(N);
        aligned.0.extend_from_slice(&bytes);
        aligned
    }

    /// Adds a byte.
    #[must_use]
    pub fn u8(self, value: u8) -> Self {
        self.number([value])
    }

    /// Adds a truth value.
    #[must_use]
    pub fn bool(self, value: bool) -> Self {
        self.u8(u8::from(value))
    }

    /// Adds a number.
    #[must_use]
    pub fn u32(self, value: u32) -> Self {
        self.number(value.to_le_bytes())
    }

    /// Adds a number.
    #[must_use]
    pub fn i32(self, value: i32) -> Self {
        self.number(value.to_le_bytes())
    }

    /// Adds a number.
    #[must_use]
    pub fn u64(self, value: u64) -> Self {
        self.number(value.to_le_bytes())
    }

    /// Adds a number.
    #[must_use]
    pub fn f32(self, value: f32) -> Self {
        self.number(value.to_le_bytes())
    }

    /// Adds a number.
    #[must_use]
    pub fn f64(self, value: f64) -> Self {
        self.number(value.to_le_bytes())
    }

    /// Adds numbers of which the reader knows how many they are.
    #[must_use]
    pub fn f64s(self, values: impl IntoIterator<Item = f64>) -> Self {
        values.into_iter().fold(self, Self::f64)
    }

    /// Its length in elements goes before a sequence.
    fn length(self, length: usize) -> Self {
        self.u32(u32::try_from(length).unwrap_or(u32::MAX))
    }

    /// Adds a text.
    #[must_use]
    pub fn text(self, text: &str) -> Self {
        let mut cdr = self.length(text.len() + 1);
        cdr.0.extend(text.as_bytes());
        cdr.0.push(0);
        cdr
    }

    /// Adds a sequence of bytes.
    #[must_use]
    pub fn bytes(self, bytes: &[u8]) -> Self {
        let mut cdr = self.length(bytes.len());
        cdr.0.extend(bytes);
        cdr
    }

    /// Adds a sequence.
    #[must_use]
    pub fn sequence<T>(self, items: &[T], add: impl Fn(Self, &T) -> Self) -> Self {
        items.iter().fold(self.length(items.len()), add)
    }

    /// Adds a `builtin_interfaces/msg/Time`.
    #[must_use]
    pub fn time(self, unix_ns: u64) -> Self {
        let (seconds, rest) = (unix_ns / 1_000_000_000, unix_ns % 1_000_000_000);
        self.i32(i32::try_from(seconds).unwrap_or(i32::MAX)).u32(u32::try_from(rest).unwrap_or(0))
    }

    /// Adds a `std_msgs/msg/Header`.
    #[must_use]
    pub fn header(self, unix_ns: u64, frame: &str) -> Self {
        self.time(unix_ns).text(frame)
    }

    /// The message.
    #[must_use]
    pub fn finish(self) -> Vec<u8> {
        self.0
    }
}

/// Takes a message apart, field by field; `None` from where it is too short.
#[derive(Clone, Debug)]
pub struct CdrFields<'a> {
    body: &'a [u8],
    at: usize,
    is_big_endian: bool,
}

impl<'a> CdrFields<'a> {
    /// The fields of a message; `None` where it is not plain CDR.
    #[must_use]
    pub fn of(message: &'a [u8]) -> Option<Self> {
        let (encapsulation, body) = message.split_first_chunk::<4>()?;
        let is_big_endian = match encapsulation {
            [0, 0, ..] => true,
            [0, 1, ..] => false,
            _ => return None,
        };
        Some(Self { body, at: 0, is_big_endian })
    }

    /// The bytes of a number.
    pub(super) fn number<const N: usize>(&mut self) -> Option<[u8; N]> {
        let at = self.at.next_multiple_of(N);
        let mut bytes = *self.body.get(at..)?.first_chunk::<N>()?;
        self.at = at + N;
        if self.is_big_endian {
            bytes.reverse();
        }
        Some(bytes)
    }

    /// Bytes that are not taken yet.
    pub(super) fn left(&self) -> usize {
        self.body.len().saturating_sub(self.at)
    }

    /// The next byte.
    pub fn u8(&mut self) -> Option<u8> {
        self.number().map(u8::from_le_bytes)
    }

    /// The next truth value.
    pub fn bool(&mut self) -> Option<bool> {
        self.u8().map(|value| value != 0)
    }

    /// The next number.
    pub fn u32(&mut self) -> Option<u32> {
        self.number().map(u32::from_le_bytes)
    }

    /// The next number.
    pub fn i32(&mut self) -> Option<i32> {
        self.number().map(i32::from_le_bytes)
    }

    /// The next number.
    pub fn u64(&mut self) -> Option<u64> {
        self.number().map(u64::from_le_bytes)
    }

    /// The next number.
    pub fn f64(&mut self) -> Option<f64> {
        self.number().map(f64::from_le_bytes)
    }

    /// The next numbers.
    pub fn f64s<const N: usize>(&mut self) -> Option<[f64; N]> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f64()?;
        }
        Some(values)
    }

    /// How many elements the next sequence has.
    pub fn length(&mut self) -> Option<usize> {
        self.u32().and_then(|length| usize::try_from(length).ok())
    }

    /// The next sequence of bytes.
    pub fn bytes(&mut self) -> Option<&'a [u8]> {
        let length = self.length()?;
        let bytes = self.body.get(self.at..)?.get(..length)?;
        self.at += length;
        Some(bytes)
    }

    /// The next text, without the zero that ends it.
    pub fn text(&mut self) -> Option<&'a str> {
        let bytes = self.bytes()?;
        std::str::from_utf8(bytes.strip_suffix(&[0]).unwrap_or(bytes)).ok()
    }

    /// The next `builtin_interfaces/msg/Time`, ns since 1970; none where it is before that.
    pub fn time(&mut self) -> Option<u64> {
        let (seconds, rest) = (self.i32()?, self.u32()?);
        Some(u64::try_from(seconds).ok()? * 1_000_000_000 + u64::from(rest))
    }

    /// The next `std_msgs/msg/Header`: its time and frame.
    pub fn header(&mut self) -> Option<(u64, &'a str)> {
        Some((self.time()?, self.text()?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_stand_at_multiples_of_their_size() {
        let cdr = Cdr::new().u8(1).u32(2).text("ab").f64(1.0).finish();
        let wanted =
            [&[0, 1, 0, 0][..], &[1, 0, 0, 0], &[2, 0, 0, 0], &[3, 0, 0, 0, b'a', b'b', 0, 0], &1.0_f64.to_le_bytes()];
        // The text ends at 15 behind the encapsulation, the number begins at 16.
        assert_eq!(cdr, wanted.concat());
    }

    #[test]
    fn what_was_built_is_taken_apart_and_nothing_beyond_its_end() {
        let message =
            Cdr::new().header(1_700_000_000_123_456_789, "finger").bool(true).f64s([1.5, -2.0]).bytes(&[1, 2, 0]);
        let message = message.finish();
        let mut fields = CdrFields::of(&message).unwrap();
        assert_eq!(fields.header(), Some((1_700_000_000_123_456_789, "finger")));
        assert_eq!((fields.bool(), fields.f64s()), (Some(true), Some([1.5, -2.0])));
        assert_eq!((fields.bytes(), fields.u8()), (Some(&[1, 2, 0][..]), None));
        let mut cut = CdrFields::of(&message[..message.len() - 1]).unwrap();
        let _ = (cut.header(), cut.bool(), cut.f64s::<2>());
        assert_eq!(cut.bytes(), None);
    }

    #[test]
    fn a_message_of_the_other_byte_order_is_read_as_well() {
        let message = [&[0, 0, 0, 0][..], &7_u32.to_be_bytes(), &[0; 4], &1.5_f64.to_be_bytes()].concat();
        let mut fields = CdrFields::of(&message).unwrap();
        assert_eq!((fields.u32(), fields.f64()), (Some(7), Some(1.5)));
        assert!(CdrFields::of(&[0, 3, 0, 0]).is_none(), "parameter lists are another encoding");
    }
}

//! Messages as ROS 2 has them on the wire: little-endian CDR, each number at a multiple of its own size.

/// Builds a message.
#[derive(Clone, Debug)]
pub(super) struct Cdr(Vec<u8>);

/// Says that little-endian plain CDR follows.
const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

impl Cdr {
    pub(super) fn new() -> Self {
        Self(ENCAPSULATION.to_vec())
    }

    /// Places count from behind the encapsulation.
    fn aligned(mut self, size: usize) -> Self {
        let behind = (self.0.len() - ENCAPSULATION.len()).next_multiple_of(size);
        self.0.resize(ENCAPSULATION.len() + behind, 0);
        self
    }

    fn number<const N: usize>(self, bytes: [u8; N]) -> Self {
        let mut aligned = self.aligned(N);
        aligned.0.extend(bytes);
        aligned
    }

    pub(super) fn u8(self, value: u8) -> Self {
        self.number([value])
    }

    pub(super) fn bool(self, value: bool) -> Self {
        self.u8(u8::from(value))
    }

    pub(super) fn u32(self, value: u32) -> Self {
        self.number(value.to_le_bytes())
    }

    pub(super) fn i32(self, value: i32) -> Self {
        self.number(value.to_le_bytes())
    }

    pub(super) fn u64(self, value: u64) -> Self {
        self.number(value.to_le_bytes())
    }

    pub(super) fn f64(self, value: f64) -> Self {
        self.number(value.to_le_bytes())
    }

    pub(super) fn f64s(self, values: impl IntoIterator<Item = f64>) -> Self {
        values.into_iter().fold(self, Self::f64)
    }

    /// Its length in elements goes before a sequence.
    fn length(self, length: usize) -> Self {
        self.u32(u32::try_from(length).unwrap_or(u32::MAX))
    }

    pub(super) fn text(self, text: &str) -> Self {
        let mut cdr = self.length(text.len() + 1);
        cdr.0.extend(text.as_bytes());
        cdr.0.push(0);
        cdr
    }

    pub(super) fn bytes(self, bytes: &[u8]) -> Self {
        let mut cdr = self.length(bytes.len());
        cdr.0.extend(bytes);
        cdr
    }

    pub(super) fn sequence<T>(self, items: &[T], add: impl Fn(Self, &T) -> Self) -> Self {
        items.iter().fold(self.length(items.len()), add)
    }

    /// `builtin_interfaces/msg/Time`.
    pub(super) fn time(self, unix_ns: u64) -> Self {
        let (seconds, rest) = (unix_ns / 1_000_000_000, unix_ns % 1_000_000_000);
        self.i32(i32::try_from(seconds).unwrap_or(i32::MAX)).u32(u32::try_from(rest).unwrap_or(0))
    }

    /// `std_msgs/msg/Header`.
    pub(super) fn header(self, unix_ns: u64, frame: &str) -> Self {
        self.time(unix_ns).text(frame)
    }

    pub(super) fn finish(self) -> Vec<u8> {
        self.0
    }
}

/// The host's time and the bytes of a `palpate_msgs/msg/LinkBytes`; `None` if it is none.
pub(super) fn link_bytes(data: &[u8]) -> Option<(u64, &[u8])> {
    let body = data.strip_prefix(&ENCAPSULATION)?;
    let (host_ns, rest) = body.split_first_chunk::<8>()?;
    let (length, bytes) = rest.split_first_chunk::<4>()?;
    let length = usize::try_from(u32::from_le_bytes(*length)).ok()?;
    Some((u64::from_le_bytes(*host_ns), bytes.get(..length)?))
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
        let linked = Cdr::new().u64(7).bytes(&[1, 2, 0]).finish();
        assert_eq!(link_bytes(&linked), Some((7, &[1, 2, 0][..])));
        assert_eq!(link_bytes(&linked[..linked.len() - 1]), None);
    }
}

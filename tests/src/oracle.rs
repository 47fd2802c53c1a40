//! Slow, obvious code that shares nothing with what it checks.

/// Longest frame without its delimiter that a reader takes, from `docs/PROTOCOL.md`.
const FRAME_MAX: usize = 197;

/// The frames in a stream: what stands between zeros, and is not empty. What comes after the last zero is none yet.
pub fn frames(bytes: &[u8]) -> impl Iterator<Item = &[u8]> {
    let end = bytes.iter().rposition(|&byte| byte == 0).unwrap_or(0);
    bytes[..end].split(|&byte| byte == 0).filter(|frame| !frame.is_empty())
}

/// The payloads of the good frames in a stream, decoded byte by byte as `docs/PROTOCOL.md` says.
#[must_use]
pub fn good_payloads(bytes: &[u8]) -> Vec<Vec<u8>> {
    frames(bytes).filter(|frame| frame.len() <= FRAME_MAX).filter_map(cobs_decode).filter_map(checked).collect()
}

/// COBS by its definition: each group is its length plus one, then its bytes; a zero follows all but a full group
/// and the last.
fn cobs_decode(frame: &[u8]) -> Option<Vec<u8>> {
    let (mut out, mut rest) = (Vec::new(), frame);
    while let Some((&code, tail)) = rest.split_first() {
        let (group, after) = tail.split_at_checked(usize::from(code) - 1)?;
        out.extend(group);
        if code != 0xFF && !after.is_empty() {
            out.push(0);
        }
        rest = after;
    }
    Some(out)
}

/// A body without its checksum, if that is right.
fn checked(body: Vec<u8>) -> Option<Vec<u8>> {
    let (payload, checksum) = body.split_last_chunk::<4>()?;
    (crc32(payload) == u32::from_le_bytes(*checksum)).then(|| payload.to_vec())
}

/// CRC-32/ISO-HDLC, bit by bit.
#[must_use]
pub fn crc32(bytes: &[u8]) -> u32 {
    let mut register = u32::MAX;
    for &byte in bytes {
        register ^= u32::from(byte);
        for _ in 0..8 {
            register = if register & 1 == 1 { register >> 1 ^ 0xEDB8_8320 } else { register >> 1 };
        }
    }
    !register
}

/// The corners of a triangle.
type Corners = [[f64; 2]; 3];

/// Positive points and weights of Gauss's rule with 6 points, for an interval of length 2.
const GAUSS_6: [(f64, f64); 3] = [
    (0.238_619_186_083_196_9, 0.467_913_934_572_691_04),
    (0.661_209_386_466_264_5, 0.360_761_573_048_138_6),
    (0.932_469_514_203_152, 0.171_324_492_379_170_35),
];

/// Most times that a triangle is quartered: the last ones beside the centre of rotation have 4⁻²⁵ of the area.
const QUARTERINGS: u32 = 25;

/// `∫ v̂ dA`, x and y, and `∫ p × v̂ dA` about the origin over a polygon, by adaptive quadrature of their definitions:
/// triangles from the first vertex, quartered until that changes nothing more than `tolerance` of their share.
#[must_use]
pub fn friction_integrals(polygon: &[[f64; 2]], velocity: [f64; 2], omega: f64, tolerance: f64) -> [f64; 3] {
    let integrand = |p: [f64; 2]| {
        let v = [velocity[0] - omega * p[1], velocity[1] + omega * p[0]];
        let speed = v[0].hypot(v[1]);
        if speed == 0.0 { [0.0; 3] } else { [v[0] / speed, v[1] / speed, (p[0] * v[1] - p[1] * v[0]) / speed] }
    };
    let mut sum = [0.0; 3];
    for pair in polygon[1..].windows(2) {
        let corners = [polygon[0], pair[0], pair[1]];
        add(&mut sum, refine(corners, &integrand, over_triangle(corners, &integrand), tolerance, QUARTERINGS));
    }
    sum
}

fn add(sum: &mut [f64; 3], more: [f64; 3]) {
    (0..3).for_each(|i| sum[i] += more[i]);
}

fn refine(
    corners: Corners,
    f: &impl Fn([f64; 2]) -> [f64; 3],
    whole: [f64; 3],
    tolerance: f64,
    depth: u32,
) -> [f64; 3] {
    let middle = |i: usize, j: usize| [0, 1].map(|k| (corners[i][k] + corners[j][k]) / 2.0);
    let [a, b, c] = corners;
    let (ab, bc, ca) = (middle(0, 1), middle(1, 2), middle(2, 0));
    let quarters = [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]];
    let parts = quarters.map(|quarter| over_triangle(quarter, f));
    let mut sum = [0.0; 3];
    parts.iter().for_each(|part| add(&mut sum, *part));
    if depth == 0 || (0..3).all(|i| (sum[i] - whole[i]).abs() < tolerance) {
        return sum;
    }
    let mut finer = [0.0; 3];
    for (quarter, part) in quarters.into_iter().zip(parts) {
        add(&mut finer, refine(quarter, f, part, tolerance / 2.0, depth - 1));
    }
    finer
}

/// 36 points on a triangle, signed by its sense: lines from the first corner to points of the opposite side.
fn over_triangle([a, b, c]: Corners, f: &impl Fn([f64; 2]) -> [f64; 3]) -> [f64; 3] {
    let twice_area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    let nodes: Vec<_> =
        GAUSS_6.iter().flat_map(|&(x, w)| [((1.0 + x) / 2.0, w / 2.0), ((1.0 - x) / 2.0, w / 2.0)]).collect();
    let mut sum = [0.0; 3];
    for &(out, w_out) in &nodes {
        for &(side, w_side) in &nodes {
            let p = [0, 1].map(|k| a[k] + out * (b[k] - a[k] + side * (c[k] - b[k])));
            let value = f(p);
            (0..3).for_each(|i| sum[i] += twice_area * out * w_out * w_side * value[i]);
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_example_on_the_protocol_page_is_a_good_frame() {
        assert_eq!(good_payloads(&[0x08, 0x01, 0x05, 0x07, 0xC3, 0xD2, 0x90, 0x1D, 0x00]), [[1, 5, 7]]);
        assert_eq!(crc32(b"123456789"), 0xCBF4_3926);
    }
    /// A disk turning about its centre: `2/3 π R³`, here a polygon of 64 corners.
    #[test]
    fn quadrature_knows_a_disk_and_a_slide() {
        let corner = |i: i32| (f64::from(i) * std::f64::consts::TAU / 64.0).sin_cos();
        let disk: Vec<_> = (0..64).map(corner).map(|(y, x)| [x, y]).collect();
        let area = 32.0 * (std::f64::consts::TAU / 64.0).sin();
        let [x, y, turn] = friction_integrals(&disk, [0.0; 2], 2.0, 1e-8);
        // The corners cut 0.16 % of the area and 0.24 % of the moment.
        assert!(
            x.abs() < 1e-6 && y.abs() < 1e-6 && (turn / (2.0 / 3.0 * std::f64::consts::PI) - 0.9976).abs() < 1e-4,
            "{turn}"
        );
        let slide = friction_integrals(&disk, [0.0, -3.0], 0.0, 1e-8);
        assert!(slide[0].abs() < 1e-12 && (slide[1] + area).abs() < 1e-12 && slide[2].abs() < 1e-12, "{slide:?}");
    }
}

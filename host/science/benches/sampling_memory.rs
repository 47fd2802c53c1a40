//! Memory of a planar subdivision: at most at any time while it is made, and kept. Run with
//! `cargo bench --bench sampling_memory`.
//!
//! Which polygons contain each loop takes a bit for each polygon, in words of 64: that is the part that grows with
//! regions × polygons. All else grows with the pieces of edges, which number about twice the regions. So the peak is
//! told in bytes a region beyond the bits, which stays the same where memory is linear, and as a multiple of regions ×
//! polygons / 64 words. Bar: linear.

use std::alloc::{GlobalAlloc, Layout, System};
use std::hint::black_box;
use std::sync::atomic::{AtomicUsize, Ordering};

use palpate::math::random::Draw;
use palpate::point_sampling::Subdivision;
use palpate::point_sampling::scenes::SceneKind;

/// Bytes in use, and the most since it was last set back.
static NOW: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

/// The system's allocator, counting what is in use. While memory is moved to a larger place both places count.
struct Counting;

#[global_allocator]
static COUNTING: Counting = Counting;

#[expect(unsafe_code, reason = "an allocator is unsafe to write; all is left to the system's, in the same terms")]
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let now = NOW.fetch_add(layout.size(), Ordering::Relaxed) + layout.size();
        PEAK.fetch_max(now, Ordering::Relaxed);
        // SAFETY: the caller keeps the terms of `alloc`, which are the same.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        NOW.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: `place` came from `alloc` above, so from the system, with this layout.
        unsafe { System.dealloc(place, layout) }
    }
}

fn main() {
    println!(
        "{:<8} {:>9} {:>8} {:>9} {:>9} {:>12} {:>18} {:>22}",
        "scene",
        "polygons",
        "regions",
        "peak MB",
        "kept MB",
        "bits B/region",
        "peak − bits B/region",
        "peak / (reg·pol/64) B"
    );
    for polygons in [50, 100, 200] {
        measure("dense", SceneKind::DENSE_POSES, polygons);
    }
    for polygons in [250, 500, 1000] {
        // The density of 100 polygons in a square of side 1.
        let side = (f64::from(polygons) / 100.0).sqrt();
        measure("sparse", SceneKind { side, ..SceneKind::SPARSE_SHAPES }, polygons);
    }
}

fn measure(name: &str, kind: SceneKind, polygons: u32) {
    let scene = kind.draw(&mut Draw::case(1, 0), polygons as usize);
    let before = NOW.load(Ordering::Relaxed);
    PEAK.store(before, Ordering::Relaxed);
    let subdivision = black_box(Subdivision::new(black_box(&scene)));
    let [peak, kept] = [&PEAK, &NOW].map(|bytes| real(bytes.load(Ordering::Relaxed) - before));
    let regions = real(subdivision.regions().count());
    let bits = 8.0 * f64::from(polygons.div_ceil(64));
    let beyond = peak / regions - bits;
    let share = peak / (regions * f64::from(polygons) / 64.0);
    let [peak, kept] = [peak, kept].map(|bytes| bytes / 1e6);
    println!("{name:<8} {polygons:>9} {regions:>8} {peak:>9.2} {kept:>9.2} {bits:>12} {beyond:>20.0} {share:>22.0}");
}

fn real(count: usize) -> f64 {
    f64::from(u32::try_from(count).unwrap_or(u32::MAX))
}

//! Whole pictures: the same bytes as saved, and ink where it is expected.

use std::path::Path;

use nalgebra::{Point2, Vector2};
use tiny_skia::Pixmap;

use super::*;

/// A scene and two charts with one of everything.
fn sampler() -> Figure {
    let mut scene = PlotScene::new("Table");
    let block = [[0.0, 0.0], [0.06, 0.0], [0.06, 0.04], [0.02, 0.055], [0.0, 0.04]].map(Point2::from);
    let outline = Stroke::solid(Colour::BLUE, 1.5);
    scene.polygon(&block, Style::area(Colour::SKY_BLUE, 0.35).outlined(outline));
    scene.disk(Point2::new(0.02, -0.015), 0.015, Stroke::solid(Colour::BLACK, 1.5).with(Dash::Dashed));
    let path: Vec<_> = (0..=20).map(f64::from).map(|k| Point2::new(0.004 * k, 0.00015 * k * k)).collect();
    scene.polyline(&path, Stroke::solid(Colour::GREEN, 1.5));
    scene.time_marks(&[(0.0, path[0]), (0.5, path[10]), (1.0, path[20])], Vector2::new(-1.0, 1.0), Colour::GREEN);
    scene.arrow(Point2::new(0.02, 0.0), Vector2::new(0.005, 0.02), Colour::VERMILLION);
    scene.label(Point2::new(0.06, 0.04), Vector2::new(1.0, 0.0), "vertex 2", Colour::BLACK);
    scene.key(Key::Area(Style::area(Colour::SKY_BLUE, 0.35).outlined(outline)), "part");
    scene.key(Key::Arrow(Colour::VERMILLION), "force on the part");
    scene.key(Key::Dot(Colour::GREEN), "centre");
    let time = |k: i32| f64::from(k) * 0.02;
    let mut series = Chart::new("Angle", ["time [s]", "u [°]"]);
    series.band(
        "95 %",
        &(0..=50).map(time).map(|t| [t, 28.0 + 9.0 * t, 32.0 + 11.0 * t]).collect::<Vec<_>>(),
        Colour::BLUE,
    );
    series.curve("felt", &(0..=50).map(time).map(|t| [t, 30.0 + 10.0 * t]).collect::<Vec<_>>(), outline);
    series.instant(0.6, "slides");
    series.level(36.0, "edge");
    let mut table = Chart::new("Strain", ["µ", "ε"]);
    table.dots("", &[[0.1, 1e-6], [0.2, 3e-6], [0.3, -2e-6]], Colour::PURPLE);
    Figure::new("Sampler of pictures", 960.0, 560.0)
        .subtitle("every kind of mark, with greek letters φ, θ, µ and signs · × ° ≤ −")
        .column(1.3, vec![scene.into()])
        .column(1.0, vec![series.into(), table.into()])
}

#[test]
fn pictures_keep_their_bytes() {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/plot_sampler.svg");
    let (svg, folder) = (sampler().to_page().to_svg(), std::env::temp_dir().join("palpate-plot-sampler.svg"));
    let saved = std::fs::read_to_string(&golden).unwrap_or_default().replace("\r\n", "\n");
    if svg != saved {
        std::fs::write(&folder, &svg).unwrap();
        let line = svg.lines().zip(saved.lines()).position(|(got, wanted)| got != wanted);
        panic!(
            "first other line: {line:?}; look at {} and, if it is right, replace {}",
            folder.display(),
            golden.display()
        );
    }
}

/// The pixel at a place of a page.
fn ink(pixels: &Pixmap, x: f64, y: f64) -> [u8; 3] {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "places on a page of 100 by 50 units")]
    let [x, y] = [x, y].map(|units| (2.0 * units).round() as u32);
    let colour = pixels.pixel(x, y).unwrap().demultiply();
    [colour.red(), colour.green(), colour.blue()]
}

#[test]
fn png_has_ink_where_shapes_are_and_none_elsewhere() {
    let mut page = Page::new(100.0, 50.0, "");
    let square = Area { left: 10.0, top: 10.0, width: 20.0, height: 20.0 };
    page.path(&square.corners(), true, Style::area(Colour::BLUE, 1.0));
    page.circle(PagePoint::new(60.0, 20.0), 10.0, Stroke::solid(Colour::VERMILLION, 2.0));
    page.path(&[PagePoint::new(80.0, 5.0), PagePoint::new(80.0, 45.0)], false, Stroke::solid(Colour::BLACK, 2.0));
    let pixels = Pixmap::decode_png(&page.to_png().unwrap()).unwrap();
    assert_eq!((pixels.width(), pixels.height()), (200, 100));
    assert_eq!(ink(&pixels, 20.0, 20.0), Colour::BLUE.rgb);
    assert_eq!(ink(&pixels, 60.0, 10.0), Colour::VERMILLION.rgb);
    assert_eq!(ink(&pixels, 80.0, 40.0), Colour::BLACK.rgb);
    for empty in [[5.0, 5.0], [60.0, 20.0], [31.0, 20.0], [90.0, 25.0]] {
        assert_eq!(ink(&pixels, empty[0], empty[1]), Colour::WHITE.rgb, "{empty:?}");
    }
}

/// The box of all that is not white, in page units: left, top, right, bottom.
fn inked_box(pixels: &Pixmap) -> [f64; 4] {
    let width = pixels.width();
    let inked = (0_u32..).zip(pixels.pixels()).filter(|(_, pixel)| pixel.red() < 250).map(|(i, _)| i);
    let none = [u32::MAX, u32::MAX, 0, 0];
    let found = inked.fold(none, |[left, top, right, bottom], i| {
        let (x, y) = (i % width, i / width);
        [left.min(x), top.min(y), right.max(x), bottom.max(y)]
    });
    found.map(|side| f64::from(side) / 2.0)
}

#[test]
fn texts_are_where_their_anchors_say_to_a_pixel() {
    let at = PagePoint::new(100.0, 100.0);
    for (anchor, upward) in
        [(Anchor::Start, false), (Anchor::Middle, false), (Anchor::End, false), (Anchor::Middle, true)]
    {
        let text = Text { upward, ..Text::new("xxxx", at, 20.0, Colour::BLACK).anchored(anchor) };
        let length = text.length();
        let mut page = Page::new(200.0, 200.0, "");
        page.text(text);
        let [left, top, right, bottom] = inked_box(&Pixmap::decode_png(&page.to_png().unwrap()).unwrap());
        let start = match anchor {
            Anchor::Start => 100.0,
            Anchor::Middle => 100.0 - 0.5 * length,
            Anchor::End => 100.0 - length,
        };
        // Upward, what was along is now down the page, counted from the end.
        let (near, across) = if upward { (200.0 - bottom, [left, right]) } else { (left, [top, bottom]) };
        let far = if upward { 200.0 - top } else { right };
        assert!((near - start).abs() < 2.0 && (far - start - length).abs() < 2.0, "{anchor:?} {upward}: {near} {far}");
        assert!((across[0] + across[1] - 200.0).abs() < 2.0, "{anchor:?} {upward}: {across:?}");
    }
}

#[test]
fn pictures_of_impossible_size_are_refused() {
    for (width, height) in [(0.0, 10.0), (10.0, -1.0), (f64::NAN, 10.0), (1e5, 10.0)] {
        let refused = Page::new(width, height, "").to_png();
        assert!(matches!(refused, Err(PlotError::Size { .. })), "{width} {height}");
    }
}

#[test]
fn formats_follow_the_file_name() {
    assert_eq!(Format::of(Path::new("a/b.svg")), Ok(Format::Svg));
    assert_eq!(Format::of(Path::new("B.PNG")), Ok(Format::Png));
    for name in ["picture", "picture.pdf", ".svg", ""] {
        let refused = Format::of(Path::new(name)).unwrap_err().to_string();
        assert!(refused.contains(".svg or .png"), "{refused}");
    }
}

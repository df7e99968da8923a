//! A page as PNG, drawn smoothly.

use tiny_skia::{
    FillRule, FilterQuality, LineCap, LineJoin, Mask, Paint, Path, PathBuilder, Pixmap, PixmapPaint, Stroke,
    StrokeDash, Transform,
};

use super::{Anchor, At, Colour, Figure, Mark, Pen, Picture, Rect, Text, font};
use crate::error::{Error, Result};

/// Pixels to the unit: 192 dots per inch.
const SCALE: f32 = 2.0;

/// Draws the page and packs it.
pub fn png(figure: &Figure) -> Result<Vec<u8>> {
    let [width, height] = [figure.width, figure.height].map(|v| (v * f64::from(SCALE)).round() as u32);
    let mut pixels = Pixmap::new(width, height)
        .ok_or_else(|| Error::Usage(format!("a figure of {width} × {height} pixels cannot be drawn")))?;
    pixels.fill(tiny_skia::Color::WHITE);
    let mut drawing = Drawing { pixels, mask: None };
    figure.marks.iter().for_each(|mark| drawing.mark(mark));
    let bytes: Vec<u8> =
        drawing.pixels.pixels().iter().flat_map(|p| [p.red(), p.green(), p.blue()]).collect();
    encoded(width, height, &bytes)
}

/// Packs red, green and blue bytes as PNG, with or without guessing at slopes: whichever is smaller.
pub fn encoded(width: u32, height: u32, bytes: &[u8]) -> Result<Vec<u8>> {
    use image::codecs::png::{CompressionType, FilterType, PngEncoder};
    let mut smallest: Option<Vec<u8>> = None;
    for filter in [FilterType::NoFilter, FilterType::Adaptive] {
        let mut packed = Vec::new();
        let encoder = PngEncoder::new_with_quality(&mut packed, CompressionType::Best, filter);
        image::ImageEncoder::write_image(encoder, bytes, width, height, image::ExtendedColorType::Rgb8)
            .map_err(|e| {
                Error::Usage(format!("a figure of {width} × {height} pixels cannot be packed: {e}"))
            })?;
        if smallest.as_ref().is_none_or(|s| packed.len() < s.len()) {
            smallest = Some(packed);
        }
    }
    Ok(smallest.unwrap_or_default())
}

/// The page so far, and what of it may be drawn on.
struct Drawing {
    pixels: Pixmap,
    mask: Option<Mask>,
}

fn paint(colour: Colour) -> Paint<'static> {
    let mut paint = Paint { anti_alias: true, ..Paint::default() };
    paint.set_color_rgba8(colour.red, colour.green, colour.blue, colour.alpha);
    paint
}

fn path(points: &[At], closed: bool) -> Option<Path> {
    let mut path = PathBuilder::new();
    for (k, &[x, y]) in points.iter().enumerate() {
        let (x, y) = (x as f32, y as f32);
        if k == 0 { path.move_to(x, y) } else { path.line_to(x, y) }
    }
    if closed {
        path.close();
    }
    path.finish()
}

impl Drawing {
    fn mark(&mut self, mark: &Mark) {
        match mark {
            Mark::Line { points, pen } => self.stroke(path(points, false), pen),
            Mark::Area { points, fill } => self.fill(path(points, true), *fill, Transform::identity()),
            Mark::Disc { centre: [x, y], radius, fill, edge } => {
                let circle = PathBuilder::from_circle(*x as f32, *y as f32, *radius as f32);
                self.fill(circle.clone(), *fill, Transform::identity());
                if let Some(pen) = edge {
                    self.stroke(circle, pen);
                }
            }
            Mark::Text(text) => self.text(text),
            Mark::Picture { place, picture } => self.picture(place, picture),
            Mark::Begin { clip: Some(clip), .. } => self.clip(clip),
            Mark::Begin { clip: None, .. } => {}
            Mark::End => self.mask = None,
        }
    }

    fn stroke(&mut self, path: Option<Path>, pen: &Pen) {
        let Some(path) = path else { return };
        let dash = pen.dash.and_then(|lengths| StrokeDash::new(lengths.map(|v| v as f32).to_vec(), 0.0));
        let stroke = Stroke {
            width: pen.width as f32,
            line_cap: LineCap::Butt,
            line_join: LineJoin::Round,
            dash,
            ..Stroke::default()
        };
        let to_pixels = Transform::from_scale(SCALE, SCALE);
        self.pixels.stroke_path(&path, &paint(pen.colour), &stroke, to_pixels, self.mask.as_ref());
    }

    fn fill(&mut self, path: Option<Path>, fill: Colour, place: Transform) {
        let Some(path) = path else { return };
        let to_pixels = place.post_scale(SCALE, SCALE);
        self.pixels.fill_path(&path, &paint(fill), FillRule::Winding, to_pixels, self.mask.as_ref());
    }

    fn text(&mut self, text: &Text) {
        let mut letters = PathBuilder::new();
        font::outline(&text.text, text.size, &mut letters);
        let width = font::width(&text.text, text.size) as f32;
        let back = match text.anchor {
            Anchor::Start => 0.0,
            Anchor::Middle => 0.5 * width,
            Anchor::End => width,
        };
        let turn = if text.upwards { -90.0 } else { 0.0 };
        let [x, y] = text.at.map(|v| v as f32);
        let place = Transform::from_translate(-back, 0.0).post_rotate(turn).post_translate(x, y);
        self.fill(letters.finish(), text.colour, place);
    }

    fn picture(&mut self, place: &Rect, picture: &Picture) {
        let Some(mut source) = Pixmap::new(picture.width, picture.height) else { return };
        for (to, from) in source.pixels_mut().iter_mut().zip(picture.bytes.chunks_exact(3)) {
            *to = tiny_skia::ColorU8::from_rgba(from[0], from[1], from[2], 255).premultiply();
        }
        let across = place.width() as f32 / picture.width as f32;
        let down = place.height() as f32 / picture.height as f32;
        let to_page = Transform::from_scale(across, down)
            .post_translate(place.low[0] as f32, place.low[1] as f32)
            .post_scale(SCALE, SCALE);
        let smooth = PixmapPaint { quality: FilterQuality::Bilinear, ..PixmapPaint::default() };
        self.pixels.draw_pixmap(0, 0, source.as_ref(), &smooth, to_page, self.mask.as_ref());
    }

    fn clip(&mut self, clip: &Rect) {
        let Some(mut mask) = Mask::new(self.pixels.width(), self.pixels.height()) else { return };
        if let Some(path) = path(&clip.corners(), true) {
            mask.fill_path(&path, FillRule::Winding, true, Transform::from_scale(SCALE, SCALE));
        }
        self.mask = Some(mask);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plot::palette;

    fn drawn(draw: impl FnOnce(&mut Figure)) -> image::RgbImage {
        let mut figure = Figure::new([40.0, 20.0], "test");
        draw(&mut figure);
        image::load_from_memory(&figure.png().unwrap()).unwrap().to_rgb8()
    }

    #[test]
    fn marks_land_where_they_should() {
        let red = Colour::new(255, 0, 0);
        let picture = drawn(|f| {
            f.disc([10.0, 10.0], 4.0, red, None);
            f.area(&[[30.0, 0.0], [40.0, 0.0], [40.0, 20.0], [30.0, 20.0]], palette::series(0).veiled(0));
            let cut = Rect::sized([20.0, 0.0], [5.0, 20.0]);
            f.group("cut", Some(cut), |f| f.line(&[[15.0, 10.0], [40.0, 10.0]], Pen::new(red, 4.0)));
            f.picture(
                Rect::sized([30.0, 0.0], [4.0, 4.0]),
                Picture { width: 1, height: 1, bytes: vec![0, 0, 255] },
            );
        });
        assert_eq!(picture.dimensions(), (80, 40));
        let at = |x, y| picture.get_pixel(x, y).0;
        assert_eq!((at(20, 20), at(20, 31)), ([255, 0, 0], [255, 255, 255]));
        assert_eq!((at(36, 20), at(45, 20), at(54, 20)), ([255; 3], [255, 0, 0], [255; 3]));
        assert_eq!((at(64, 4), at(64, 30)), ([0, 0, 255], [255; 3]));
    }

    #[test]
    fn text_is_anchored_and_turned() {
        let dark = |picture: &image::RgbImage, x: std::ops::Range<u32>, y: std::ops::Range<u32>| {
            x.flat_map(|x| y.clone().map(move |y| (x, y)))
                .filter(|&(x, y)| picture.get_pixel(x, y).0[0] < 128)
                .count()
        };
        let end = drawn(|f| f.text(Text::new([20.0, 15.0], 10.0, "HH").anchored(Anchor::End)));
        assert!(dark(&end, 0..40, 0..40) > 50 && dark(&end, 41..80, 0..40) == 0);
        let up = drawn(|f| f.text(Text { upwards: true, ..Text::new([20.0, 19.0], 10.0, "HH") }));
        assert!(dark(&up, 24..41, 0..38) > 50 && dark(&up, 42..80, 0..40) == 0);
    }

    #[test]
    fn a_page_without_extent_is_refused() {
        assert_eq!(Figure::new([0.0, 10.0], "").png().unwrap_err().exit_code(), 2);
    }
}

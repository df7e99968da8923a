//! The letters of figures: DejaVu Sans, carried within the program.

use std::sync::OnceLock;

use ttf_parser::{Face, GlyphId, OutlineBuilder};

/// The fonts that an SVG asks its viewer for: ours, or the nearest that are common.
pub const FAMILY: &str = "DejaVu Sans, Bitstream Vera Sans, Verdana, Geneva, sans-serif";

static FONT: &[u8] = include_bytes!("../../../data/fonts/DejaVuSans.ttf");

fn face() -> &'static Face<'static> {
    static FACE: OnceLock<Face<'static>> = OnceLock::new();
    FACE.get_or_init(|| Face::parse(FONT, 0).expect("the font that the program carries is whole"))
}

/// The letter's shape; a box for letters that the font does not have.
fn glyph(letter: char) -> GlyphId {
    face().glyph_index(letter).unwrap_or(GlyphId(0))
}

fn advance(glyph: GlyphId, size: f64) -> f64 {
    f64::from(face().glyph_hor_advance(glyph).unwrap_or(0)) * size / f64::from(face().units_per_em())
}

/// How wide a line of text is at this size.
pub fn width(text: &str, size: f64) -> f64 {
    text.chars().map(|c| advance(glyph(c), size)).sum()
}

/// Breaks a text into lines no wider than `limit`, at spaces; a longer word stands alone.
pub fn wrapped(text: &str, size: f64, limit: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if width(&format!("{line} {word}"), size) <= limit => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// Draws the outlines of a line of text that begins at (0, 0), y down, into a path.
pub fn outline(text: &str, size: f64, path: &mut tiny_skia::PathBuilder) {
    let scale = (size / f64::from(face().units_per_em())) as f32;
    let mut x = 0.0;
    for letter in text.chars() {
        let glyph = glyph(letter);
        // A space has no outline, and needs none.
        let _ = face().outline_glyph(glyph, &mut Letter { path, scale, x: x as f32 });
        x += advance(glyph, size);
    }
}

/// Moves a letter's outline to its place.
struct Letter<'a> {
    path: &'a mut tiny_skia::PathBuilder,
    scale: f32,
    x: f32,
}

impl Letter<'_> {
    fn at(&self, x: f32, y: f32) -> (f32, f32) {
        (self.x + x * self.scale, -y * self.scale)
    }
}

impl OutlineBuilder for Letter<'_> {
    fn move_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.at(x, y);
        self.path.move_to(x, y);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.at(x, y);
        self.path.line_to(x, y);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        let ((x1, y1), (x, y)) = (self.at(x1, y1), self.at(x, y));
        self.path.quad_to(x1, y1, x, y);
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        let ((x1, y1), (x2, y2), (x, y)) = (self.at(x1, y1), self.at(x2, y2), self.at(x, y));
        self.path.cubic_to(x1, y1, x2, y2, x, y);
    }

    fn close(&mut self) {
        self.path.close();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_letters_of_labels_are_there() {
        let used = "The quick brown fox, 0123456789 ⁻⁰¹²³⁴⁵⁶⁷⁸⁹ × − · … – “ ” ° ² ³ α β θ λ μ π σ √ ∞ ≈ ≤ ≥ → Ä ö ñ Ж";
        for letter in used.chars() {
            assert!(face().glyph_index(letter).is_some(), "{letter}");
        }
        assert_eq!(glyph('\u{10ffff}'), GlyphId(0));
        assert!(
            width("wide", 10.0) > width("ill", 10.0)
                && (width("ab", 20.0) - 2.0 * width("ab", 10.0)).abs() < 1e-9
        );
    }

    #[test]
    fn lines_break_at_spaces() {
        let lines = wrapped("one two three four", 10.0, width("one two ", 10.0));
        assert_eq!(lines, ["one two", "three", "four"]);
        assert_eq!(wrapped("immeasurable", 10.0, 1.0), ["immeasurable"]);
    }
}

//! A page: marks in the order they are drawn, written as SVG or drawn as PNG.

mod bitmap;
pub mod font;
mod svg;

use std::path::{Path, PathBuf};

use crate::error::Result;
use crate::output::file;

/// A place on the page, in its units: 1/96 inch, x to the right, y down.
pub type At = [f64; 2];

/// A colour, eight-bit sRGB, and how opaque it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Colour {
    /// Red.
    pub red: u8,
    /// Green.
    pub green: u8,
    /// Blue.
    pub blue: u8,
    /// 255 hides what is below.
    pub alpha: u8,
}

impl Colour {
    /// An opaque colour.
    pub const fn new(red: u8, green: u8, blue: u8) -> Self {
        Self { red, green, blue, alpha: 255 }
    }

    /// The same, this opaque (0 to 255).
    pub const fn veiled(self, alpha: u8) -> Self {
        Self { alpha, ..self }
    }
}

/// How a line is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pen {
    /// Its colour.
    pub colour: Colour,
    /// Its width.
    pub width: f64,
    /// Lengths of dash and gap; none for a line without gaps.
    pub dash: Option<[f64; 2]>,
}

impl Pen {
    /// A line without gaps.
    pub const fn new(colour: Colour, width: f64) -> Self {
        Self { colour, width, dash: None }
    }
}

/// Where a text stands relative to its place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Anchor {
    /// It begins there.
    Start,
    /// It is centred there.
    Middle,
    /// It ends there.
    End,
}

/// A line of text.
#[derive(Debug, Clone, PartialEq)]
pub struct Text {
    /// Where its base line is.
    pub at: At,
    /// What it says.
    pub text: String,
    /// Height of its letters' em.
    pub size: f64,
    /// Which part of it stands at the place.
    pub anchor: Anchor,
    /// Turned to read upwards.
    pub upwards: bool,
    /// Its colour.
    pub colour: Colour,
}

impl Text {
    /// Dark text that begins at a place.
    pub fn new(at: At, size: f64, text: impl Into<String>) -> Self {
        Self {
            at,
            text: text.into(),
            size,
            anchor: Anchor::Start,
            upwards: false,
            colour: super::palette::INK,
        }
    }

    /// The same, anchored otherwise.
    pub fn anchored(self, anchor: Anchor) -> Self {
        Self { anchor, ..self }
    }

    /// The same in another colour.
    pub fn coloured(self, colour: Colour) -> Self {
        Self { colour, ..self }
    }
}

/// A box on the page.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rect {
    /// Its upper left corner.
    pub low: At,
    /// Its lower right corner.
    pub high: At,
}

impl Rect {
    /// From its upper left corner and its size.
    pub fn sized([x, y]: At, [width, height]: [f64; 2]) -> Self {
        Self { low: [x, y], high: [x + width, y + height] }
    }

    /// How wide it is.
    pub fn width(&self) -> f64 {
        self.high[0] - self.low[0]
    }

    /// How high it is.
    pub fn height(&self) -> f64 {
        self.high[1] - self.low[1]
    }

    /// Its middle.
    pub fn centre(&self) -> At {
        [0.5 * (self.low[0] + self.high[0]), 0.5 * (self.low[1] + self.high[1])]
    }

    /// Whether a place lies in it.
    pub fn holds(&self, at: At) -> bool {
        (0..2).all(|k| at[k] >= self.low[k] && at[k] <= self.high[k])
    }

    /// The same, wider by `by` on every side.
    pub fn grown(&self, by: f64) -> Self {
        Self { low: self.low.map(|v| v - by), high: self.high.map(|v| v + by) }
    }

    /// Its corners, clockwise from the upper left.
    pub fn corners(&self) -> [At; 4] {
        [self.low, [self.high[0], self.low[1]], self.high, [self.low[0], self.high[1]]]
    }
}

/// Pixels within a page.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Red, green, blue of each pixel, sRGB, rows from the top.
    pub bytes: Vec<u8>,
}

/// One thing drawn.
#[derive(Debug, Clone, PartialEq)]
enum Mark {
    Line { points: Vec<At>, pen: Pen },
    Area { points: Vec<At>, fill: Colour },
    Disc { centre: At, radius: f64, fill: Colour, edge: Option<Pen> },
    Text(Text),
    Picture { place: Rect, picture: Picture },
    Begin { name: String, clip: Option<Rect> },
    End,
}

/// A page of marks. What is drawn later lies above.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    width: f64,
    height: f64,
    title: String,
    marks: Vec<Mark>,
}

impl Figure {
    /// A white page of this size in units of 1/96 inch. The title is for those who cannot see it; nothing draws it.
    pub fn new([width, height]: [f64; 2], title: impl Into<String>) -> Self {
        Self { width, height, title: title.into(), marks: Vec::new() }
    }

    /// The whole page.
    pub fn page(&self) -> Rect {
        Rect::sized([0.0, 0.0], [self.width, self.height])
    }

    /// A line through points.
    pub fn line(&mut self, points: &[At], pen: Pen) {
        self.marks.push(Mark::Line { points: points.to_vec(), pen });
    }

    /// A filled area within points.
    pub fn area(&mut self, points: &[At], fill: Colour) {
        self.marks.push(Mark::Area { points: points.to_vec(), fill });
    }

    /// The outline of a box.
    pub fn outline(&mut self, rect: &Rect, pen: Pen) {
        let [a, b, c, d] = rect.corners();
        // Begins within a side, so that all corners are joined.
        let middle = [rect.centre()[0], a[1]];
        self.line(&[middle, b, c, d, a, middle], pen);
    }

    /// A disc, with an edge if asked.
    pub fn disc(&mut self, centre: At, radius: f64, fill: Colour, edge: Option<Pen>) {
        self.marks.push(Mark::Disc { centre, radius, fill, edge });
    }

    /// A line of text.
    pub fn text(&mut self, text: Text) {
        self.marks.push(Mark::Text(text));
    }

    /// A picture stretched over a box.
    pub fn picture(&mut self, place: Rect, picture: Picture) {
        self.marks.push(Mark::Picture { place, picture });
    }

    /// Draws marks that belong together under a name, cut off at a box if one is given. Groups with a box do not nest.
    pub fn group(&mut self, name: impl Into<String>, clip: Option<Rect>, draw: impl FnOnce(&mut Self)) {
        self.marks.push(Mark::Begin { name: name.into(), clip });
        draw(self);
        self.marks.push(Mark::End);
    }

    /// The page as SVG.
    pub fn svg(&self) -> String {
        svg::text(self)
    }

    /// The page as PNG, two pixels to the unit (192 dots per inch).
    ///
    /// # Errors
    /// [`Error::Usage`](crate::Error::Usage) for a page without extent or too large to be held.
    pub fn png(&self) -> Result<Vec<u8>> {
        bitmap::png(self)
    }

    /// Writes `stem`.svg and `stem`.png, each whole or not at all, and names them in this order.
    ///
    /// # Errors
    /// [`Error::Io`](crate::Error::Io), [`Error::DiskFull`](crate::Error::DiskFull), and as [`Figure::png`].
    pub fn write(&self, stem: &Path) -> Result<Vec<PathBuf>> {
        let mut files = Vec::new();
        for (ending, bytes) in [("svg", self.svg().into_bytes()), ("png", self.png()?)] {
            let path = ended(stem, ending);
            file::write_bytes(&path, &bytes)?;
            files.push(path);
        }
        Ok(files)
    }
}

/// `stem` with an ending put after whatever points it has.
fn ended(stem: &Path, ending: &str) -> PathBuf {
    let mut name = stem.as_os_str().to_owned();
    name.push(".");
    name.push(ending);
    name.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn endings_come_after_points_in_names() {
        assert_eq!(ended(Path::new("a/error_0.5"), "svg"), Path::new("a/error_0.5.svg"));
    }
}

//! Series: data of one kind, and how they look.

use super::canvas::{At, Colour, Figure, Pen, Rect, Text};
use super::palette;
use super::panel::Panel;

/// How a series is drawn.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Style {
    /// A line from point to point, in their order.
    #[default]
    Line,
    /// A marker at each point; series have markers of different shapes.
    Markers,
    /// A line with a marker at each point.
    LineMarkers,
    /// A dashed line, as for guides and limits.
    Dashed,
    /// A bar at each x, as high as y; several such series stand side by side.
    Bars,
}

/// Data of one kind.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Series {
    /// What the legend calls it; nothing if empty.
    pub name: String,
    /// x and y, in the order in which a line connects them.
    pub points: Vec<[f64; 2]>,
    /// How it is drawn.
    pub style: Style,
    /// Short texts beside the points, in their order; may be fewer or none.
    pub labels: Vec<String>,
    /// Its colour and marker by number; its place among the series without it.
    pub tint: Option<usize>,
}

impl Series {
    /// Without labels, coloured by its place.
    pub fn new(name: impl Into<String>, style: Style, points: Vec<[f64; 2]>) -> Self {
        Self { name: name.into(), points, style, ..Self::default() }
    }
}

/// Half the size of a marker.
pub const MARKER: f64 = 4.2;
/// The width of lines.
const LINE: f64 = 1.8;
/// Height of labels of points.
const LABEL: f64 = 9.5;

/// A series on the page: the points that its axes have places for.
pub struct Drawn<'a> {
    pub series: &'a Series,
    pub colour: Colour,
    pub tint: usize,
    /// Places on the page, and the labels there.
    pub places: Vec<(At, Option<&'a str>)>,
    /// Half the width of bars, and where they stand.
    pub bars: (f64, f64),
}

impl Drawn<'_> {
    /// Draws the series.
    pub fn draw(&self, figure: &mut Figure) {
        let pen = Pen::new(self.colour, LINE);
        figure.group("series", None, |figure| {
            let line: Vec<At> = self.places.iter().map(|p| p.0).collect();
            match self.series.style {
                Style::Line | Style::LineMarkers if line.len() > 1 => figure.line(&line, pen),
                Style::Dashed => figure.line(&line, Pen { width: 1.4, dash: Some([6.0, 4.0]), ..pen }),
                Style::Bars => line.iter().for_each(|&at| figure.area(&self.bar(at).corners(), self.colour)),
                _ => {}
            }
            // A line of one point would not show.
            let single = self.series.style == Style::Line && line.len() == 1;
            if single || matches!(self.series.style, Style::Markers | Style::LineMarkers) {
                line.iter().for_each(|&at| marker(figure, at, self.tint, self.colour));
            }
            for (at, label) in &self.places {
                if let Some(label) = label {
                    figure.text(Text::new(beside(*at), LABEL, *label).coloured(self.colour));
                }
            }
        });
    }

    /// The bar that ends at a place.
    fn bar(&self, [x, y]: At) -> Rect {
        let (half, base) = self.bars;
        Rect { low: [x - half, y.min(base)], high: [x + half, y.max(base)] }
    }

    /// Places that the series covers, close enough to each other to tell whether a box is free.
    pub fn covered(&self) -> Vec<At> {
        let mut places: Vec<At> = self.places.iter().map(|p| p.0).collect();
        if self.series.style == Style::Bars {
            places = self.places.iter().flat_map(|p| filled(&self.bar(p.0))).collect();
        } else if self.series.style != Style::Markers {
            let pairs: Vec<[At; 2]> = places.windows(2).map(|w| [w[0], w[1]]).collect();
            for [a, b] in pairs {
                let steps = ((b[0] - a[0]).hypot(b[1] - a[1]) / 4.0).ceil().clamp(1.0, 4000.0);
                places.extend(
                    (0..steps as usize).map(|k| [0, 1].map(|i| a[i] + (b[i] - a[i]) * k as f64 / steps)),
                );
            }
        }
        for (at, label) in &self.places {
            let width = label.map_or(0.0, |l| super::canvas::font::width(l, LABEL));
            places.extend(
                (0..(width / 4.0) as usize).map(|k| [beside(*at)[0] + 4.0 * k as f64, beside(*at)[1]]),
            );
        }
        places
    }
}

/// Where a point's label begins.
fn beside([x, y]: At) -> At {
    [x + MARKER + 2.0, y - MARKER]
}

fn filled(rect: &Rect) -> Vec<At> {
    let steps = |extent: f64| (extent / 4.0).ceil().clamp(1.0, 400.0) as usize;
    let (across, down) = (steps(rect.width()), steps(rect.height()));
    let at = |i: usize, j: usize| {
        let part = [i as f64 / across as f64, j as f64 / down as f64];
        [rect.low[0] + rect.width() * part[0], rect.low[1] + rect.height() * part[1]]
    };
    (0..=across).flat_map(|i| (0..=down).map(move |j| (i, j))).map(|(i, j)| at(i, j)).collect()
}

/// The marker of a series' number: a disc, square, triangle, diamond, and so on.
pub fn marker(figure: &mut Figure, [x, y]: At, number: usize, colour: Colour) {
    let r = MARKER;
    let shape: &[At] = match number % 5 {
        0 => {
            figure.disc([x, y], r, colour, Some(Pen::new(palette::PAPER, 0.8)));
            return;
        }
        1 => &[[-0.9, -0.9], [0.9, -0.9], [0.9, 0.9], [-0.9, 0.9]],
        2 => &[[0.0, -1.2], [1.15, 0.85], [-1.15, 0.85]],
        3 => &[[0.0, -1.35], [1.35, 0.0], [0.0, 1.35], [-1.35, 0.0]],
        _ => &[[0.0, 1.2], [1.15, -0.85], [-1.15, -0.85]],
    };
    let mut corners: Vec<At> = shape.iter().map(|[dx, dy]| [x + r * dx, y + r * dy]).collect();
    figure.area(&corners, colour);
    corners.push(corners[0]);
    figure.line(&corners, Pen::new(palette::PAPER, 0.8));
}

/// What the legend shows for a series, centred at a place.
pub fn sample(figure: &mut Figure, [x, y]: At, style: Style, (number, colour): (usize, Colour)) {
    let across = [[x - 11.0, y], [x + 11.0, y]];
    match style {
        Style::Bars => figure.area(&Rect::sized([x - 6.0, y - 5.0], [12.0, 10.0]).corners(), colour),
        Style::Dashed => {
            figure.line(&across, Pen { dash: Some([6.0, 4.0]), ..Pen::new(colour, 1.4) });
        }
        Style::Line | Style::LineMarkers => figure.line(&across, Pen::new(colour, LINE)),
        Style::Markers => {}
    }
    if matches!(style, Style::Markers | Style::LineMarkers) {
        marker(figure, [x, y], number, colour);
    }
}

/// Puts the series on a panel.
pub fn place<'a>(all: &'a [Series], panel: &Panel, shows: impl Fn([f64; 2]) -> bool) -> Vec<Drawn<'a>> {
    let bars: Vec<&Series> = all.iter().filter(|s| s.style == Style::Bars).collect();
    let step = narrowest(&bars, panel);
    let base = if panel.y.ends()[0] < 0.0 { 0.0 } else { panel.y.ends()[0] };
    let mut stood = 0;
    let mut drawn = Vec::new();
    for (k, series) in all.iter().enumerate() {
        let slot = if series.style == Style::Bars { stood } else { 0 };
        stood += usize::from(series.style == Style::Bars);
        let width = 0.84 * step / bars.len().max(1) as f64;
        let shift = match series.style {
            Style::Bars => width * (slot as f64 - 0.5 * (bars.len() as f64 - 1.0)),
            _ => 0.0,
        };
        let label = |i: usize| series.labels.get(i).map(String::as_str).filter(|l| !l.is_empty());
        let on_page = |point| {
            let [x, y] = panel.at(point);
            [x + shift, y]
        };
        let shown = series.points.iter().enumerate().filter(|(_, p)| shows(**p));
        let places: Vec<_> = shown.map(|(i, p)| (on_page(*p), label(i))).collect();
        let tint = series.tint.unwrap_or(k);
        let base = panel.at([panel.x.ends()[0], base])[1];
        drawn.push(Drawn { series, colour: palette::series(tint), tint, places, bars: (0.5 * width, base) });
    }
    drawn
}

/// The smallest distance on the page between bars of different x: the room that each has.
fn narrowest(bars: &[&Series], panel: &Panel) -> f64 {
    let mut x: Vec<f64> = bars
        .iter()
        .flat_map(|s| &s.points)
        .map(|p| panel.at([p[0], panel.y.ends()[1]])[0])
        .filter(|x| x.is_finite())
        .collect();
    x.sort_by(f64::total_cmp);
    let widest = 0.2 * panel.rect.width();
    x.windows(2).map(|w| w[1] - w[0]).filter(|d| *d > 1e-6).fold(widest, f64::min)
}

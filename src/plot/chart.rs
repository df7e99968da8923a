//! A chart: series over two axes, with a title, a legend that covers no data, and notes below.

use std::path::{Path, PathBuf};

use super::axis::{Axis, Scale};
use super::canvas::{Anchor, At, Figure, Pen, Rect, Text, font};
use super::palette;
use super::panel::Panel;
use super::series::{self, Drawn, MARKER};
pub use super::series::{Series, Style};
use crate::error::Result;

/// A chart's page: 6.7 by 4.4 inches.
const SIZE: [f64; 2] = [640.0, 420.0];
/// Height of the title.
const TITLE: f64 = 14.0;
/// Height of notes.
const NOTE: f64 = 10.0;
/// Height of the legend's names.
const NAME: f64 = 11.0;
/// From line to line of the legend.
const LINE: f64 = 17.0;
/// Room for the legend's samples.
const SAMPLE: f64 = 34.0;
/// White around everything.
const MARGIN: f64 = 10.0;

/// Data of several kinds over two axes.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Chart {
    /// What is shown, above; nothing if empty.
    pub title: String,
    /// From left to right.
    pub x: Axis,
    /// From bottom to top.
    pub y: Axis,
    /// The data; later series lie above earlier ones.
    pub series: Vec<Series>,
    /// Small text below: conditions, what was left out.
    pub notes: Vec<String>,
}

impl Chart {
    /// A chart without data yet.
    pub fn new(title: impl Into<String>, x: Axis, y: Axis) -> Self {
        Self { title: title.into(), x, y, ..Self::default() }
    }

    /// Writes `stem`.svg and `stem`.png and names them in this order; the folder must be there.
    ///
    /// Points that are not finite, and those not positive on a log axis, are left out, and a note says how many. A chart
    /// without any point says so. The same chart gives the same bytes.
    ///
    /// # Errors
    /// [`crate::Error::Io`] and [`crate::Error::DiskFull`].
    pub fn write(&self, stem: &Path) -> Result<Vec<PathBuf>> {
        self.figure().write(stem)
    }

    /// The chart on a page of its own.
    pub fn figure(&self) -> Figure {
        let mut figure = Figure::new(SIZE, &self.title);
        let page = figure.page().grown(-MARGIN);
        self.draw(&mut figure, &page);
        figure
    }

    /// Draws the chart into a part of a page.
    pub fn draw(&self, figure: &mut Figure, area: &Rect) {
        let notes = self.notes_within(area.width());
        let mut inner = *area;
        inner.low[1] += if self.title.is_empty() { 0.0 } else { TITLE + 12.0 };
        inner.high[1] -= 1.3 * NOTE * notes.len() as f64 + if notes.is_empty() { 0.0 } else { 6.0 };
        let names: Vec<&Series> = self.series.iter().filter(|s| !s.name.is_empty()).collect();
        let widest = names.iter().map(|s| font::width(&s.name, NAME)).fold(0.0, f64::max);
        let size = [SAMPLE + widest + 8.0, LINE * names.len() as f64 + 6.0];
        let mut panel = self.panel(&inner);
        // The legend goes where no data are, else outside: to the right, or above if it is too wide for that.
        let place = free_place(&panel, size, &self.placed(&panel)).unwrap_or_else(|| {
            let beside = size[0] < 0.35 * area.width();
            let low = if beside {
                [area.high[0] - size[0], panel.rect.low[1]]
            } else {
                [panel.rect.low[0], inner.low[1]]
            };
            inner.high[0] -= if beside { size[0] } else { 0.0 };
            inner.low[1] += if beside { 0.0 } else { size[1] + 4.0 };
            panel = self.panel(&inner);
            Rect::sized(low, size)
        });
        let drawn = self.placed(&panel);
        panel.grid(figure);
        drawn.iter().for_each(|d| d.draw(figure));
        panel.frame(figure, &self.x, &self.y);
        if drawn.iter().all(|d| d.places.is_empty()) {
            let none = Text::new(panel.rect.centre(), 14.0, "no data").anchored(Anchor::Middle);
            figure.text(none.coloured(palette::FAINT));
        }
        if !names.is_empty() {
            legend(figure, &place, &drawn);
        }
        let title = Text::new([panel.rect.centre()[0], area.low[1] + TITLE], TITLE, &self.title);
        figure.text(title.anchored(Anchor::Middle));
        for (k, note) in notes.iter().enumerate() {
            let y = inner.high[1] + 6.0 + 1.3 * NOTE * (k as f64 + 0.8);
            figure.text(Text::new([area.low[0], y], NOTE, note).coloured(palette::FAINT));
        }
    }

    fn panel(&self, area: &Rect) -> Panel {
        let bars = self.series.iter().any(|s| s.style == Style::Bars);
        let shown = || self.series.iter().flat_map(|s| &s.points).filter(|p| self.shows(**p));
        let x = Scale::over(&self.x, self.ends_of_bars().into_iter().chain(shown().map(|p| p[0])), false);
        let y = Scale::over(&self.y, shown().map(|p| p[1]), bars);
        Panel::within(area, x, y)
    }

    /// How far the outermost bars reach to both sides.
    fn ends_of_bars(&self) -> Vec<f64> {
        let bars = self.series.iter().filter(|s| s.style == Style::Bars);
        let mut x: Vec<f64> =
            bars.flat_map(|s| &s.points).filter(|p| self.shows(**p)).map(|p| p[0]).collect();
        x.sort_by(f64::total_cmp);
        x.dedup();
        let ([.., before, last], [first, next, ..]) = (&x[..], &x[..]) else { return Vec::new() };
        if self.x.log {
            vec![first * (first / next).sqrt(), last * (last / before).sqrt()]
        } else {
            vec![first - 0.5 * (next - first), last + 0.5 * (last - before)]
        }
    }

    /// Whether both axes have a place for a point, and within their ends if these are given.
    fn shows(&self, point: [f64; 2]) -> bool {
        [&self.x, &self.y].iter().zip(point).all(|(axis, value)| {
            axis.shows(value) && axis.range.is_none_or(|[low, high]| low <= value && value <= high)
        })
    }

    fn placed(&self, panel: &Panel) -> Vec<Drawn<'_>> {
        series::place(&self.series, panel, |point| self.shows(point))
    }

    /// The notes, and what has been left out, in lines.
    fn notes_within(&self, width: f64) -> Vec<String> {
        let mut notes = self.notes.clone();
        for series in &self.series {
            let count = series.points.iter().filter(|p| !self.shows(**p)).count();
            if count > 0 {
                let points = if count == 1 { "1 point" } else { &format!("{count} points") };
                let of =
                    if series.name.is_empty() { String::new() } else { format!(" of “{}”", series.name) };
                notes.push(format!(
                    "{points}{of} left out: not finite, not positive on a log axis, or out of range."
                ));
            }
        }
        notes.iter().flat_map(|note| font::wrapped(note, NOTE, width)).collect()
    }
}

/// A box of this size within the panel that covers no data, if there is one.
fn free_place(panel: &Panel, size: [f64; 2], drawn: &[Drawn<'_>]) -> Option<Rect> {
    let covered: Vec<At> = drawn.iter().flat_map(Drawn::covered).collect();
    let room = panel.rect.grown(-8.0);
    let slack = [room.width() - size[0], room.height() - size[1]];
    if slack.iter().any(|&s| s < 0.0) || size[0] > 0.5 * panel.rect.width() {
        return None;
    }
    // Corners first, the upper right before all.
    let places =
        [[1.0, 0.0], [0.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.5, 0.0], [1.0, 0.5], [0.0, 0.5], [0.5, 1.0]];
    let boxes =
        places.map(|[x, y]| Rect::sized([room.low[0] + x * slack[0], room.low[1] + y * slack[1]], size));
    boxes.into_iter().find(|rect| {
        let near = rect.grown(MARKER + 3.0);
        !covered.iter().any(|&at| near.holds(at))
    })
}

fn legend(figure: &mut Figure, place: &Rect, drawn: &[Drawn<'_>]) {
    figure.group("legend", None, |figure| {
        figure.area(&place.corners(), palette::PAPER.veiled(230));
        figure.outline(place, Pen::new(palette::GRID, 1.0));
        let named = drawn.iter().filter(|d| !d.series.name.is_empty());
        for (k, one) in named.enumerate() {
            let y = place.low[1] + 3.0 + LINE * (k as f64 + 0.5);
            series::sample(
                figure,
                [place.low[0] + 0.5 * SAMPLE, y],
                one.series.style,
                (one.tint, one.colour),
            );
            figure.text(Text::new([place.low[0] + SAMPLE, y + 0.36 * NAME], NAME, &one.series.name));
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart(points: Vec<[f64; 2]>, style: Style) -> Chart {
        let mut chart = Chart::new("t", Axis::log("x"), Axis::log("y"));
        chart.series.push(Series::new("one", style, points));
        chart
    }

    #[test]
    fn what_has_no_place_on_a_log_axis_is_left_out_and_told() {
        let text =
            chart(vec![[1.0, 2.0], [0.0, 1.0], [2.0, f64::NAN], [3.0, 3.0]], Style::Markers).figure().svg();
        assert!(text.contains(">2 points of “one” left out"), "{text}");
        // Two markers and the legend's.
        assert_eq!(text.matches("<circle").count(), 3);
    }

    #[test]
    fn charts_of_nothing_and_of_one_point_can_be_drawn() {
        for style in [Style::Line, Style::Markers, Style::LineMarkers, Style::Dashed, Style::Bars] {
            let text = chart(vec![], style).figure().svg();
            assert!(text.contains(">no data<") && !text.contains("NaN") && !text.contains("inf"), "{text}");
            let text = chart(vec![[3.0, 5.0]], style).figure().svg();
            assert!(!text.contains("no data") && !text.contains("NaN") && !text.contains("inf"), "{text}");
        }
        assert!(Chart::default().figure().svg().contains("no data"));
    }

    #[test]
    fn the_legend_covers_no_data() {
        // A line through every corner and side of the panel leaves no place within.
        let around = vec![[1.0, 1.0], [100.0, 1.0], [100.0, 50.0], [100.0, 100.0], [1.0, 100.0], [1.0, 1.0]];
        for (points, inside) in [(around, false), (vec![[1.0, 1.0], [10.0, 10.0]], true)] {
            let chart = chart(points, Style::Line);
            let page = Rect::sized([0.0, 0.0], SIZE);
            let panel = chart.panel(&page);
            let place = free_place(&panel, [120.0, 60.0], &chart.placed(&panel));
            assert_eq!(place.is_some(), inside);
        }
    }

    #[test]
    fn bars_of_two_series_stand_side_by_side() {
        let mut chart = chart(vec![[1.0, 4.0], [2.0, 8.0]], Style::Bars);
        chart.series.push(Series::new("two", Style::Bars, vec![[1.0, 2.0], [2.0, 3.0]]));
        let panel = chart.panel(&Rect::sized([0.0, 0.0], SIZE));
        let drawn = chart.placed(&panel);
        let (half, x) = (drawn[0].bars.0, |s: usize, p: usize| drawn[s].places[p].0[0]);
        assert!((x(1, 0) - x(0, 0) - 2.0 * half).abs() < 1e-9 && x(0, 1) - x(1, 0) > 2.0 * half);
    }
}

//! The part of a chart that data lie in: its frame, grid, ticks and labels.

use super::axis::{Axis, Scale, Tick};
use super::canvas::{Anchor, At, Figure, Pen, Rect, Text, font};
use super::palette;

/// Height of labels.
pub const LABEL: f64 = 12.0;
/// Height of what ticks say.
const TICK: f64 = 11.0;
/// Length of ticks that say something.
const TICK_LENGTH: f64 = 5.0;
/// Between ticks, their labels and the axis' label.
const GAP: f64 = 6.0;

/// Where data lie, and how they are mapped there.
#[derive(Debug, Clone, Copy)]
pub struct Panel {
    /// The frame.
    pub rect: Rect,
    /// Left to right.
    pub x: Scale,
    /// Bottom to top.
    pub y: Scale,
}

impl Panel {
    /// The panel that fits into `area` with its ticks and labels outside of it.
    pub fn within(area: &Rect, x: Scale, y: Scale) -> Self {
        let widest = y
            .ticks()
            .iter()
            .filter_map(|t| t.label.as_ref())
            .map(|l| font::width(l, TICK))
            .fold(0.0, f64::max);
        let left = TICK_LENGTH + GAP + widest + GAP + LABEL;
        let bottom = TICK_LENGTH + GAP + TICK + GAP + LABEL;
        // What the last tick says may stand out to the right by half.
        let rect = Rect {
            low: [area.low[0] + left, area.low[1] + 0.5 * TICK],
            high: [area.high[0] - 1.5 * TICK, area.high[1] - bottom],
        };
        Self { rect, x, y }
    }

    /// Where a point of data is on the page.
    pub fn at(&self, [x, y]: [f64; 2]) -> At {
        [
            self.rect.low[0] + self.x.share(x) * self.rect.width(),
            self.rect.high[1] - self.y.share(y) * self.rect.height(),
        ]
    }

    /// Draws the grid, to lie below data.
    pub fn grid(&self, figure: &mut Figure) {
        let pen = Pen::new(palette::GRID, 0.8);
        let Rect { low: [left, top], high: [right, bottom] } = self.rect;
        figure.group("grid", None, |figure| {
            for tick in self.x.ticks().iter().filter(|t| t.label.is_some()) {
                let x = left + self.x.share(tick.value) * self.rect.width();
                figure.line(&[[x, top], [x, bottom]], pen);
            }
            for tick in self.y.ticks().iter().filter(|t| t.label.is_some()) {
                let y = bottom - self.y.share(tick.value) * self.rect.height();
                figure.line(&[[left, y], [right, y]], pen);
            }
        });
    }

    /// Draws frame, ticks and labels, to lie above data.
    pub fn frame(&self, figure: &mut Figure, x: &Axis, y: &Axis) {
        let [across, up] = [self.rect.centre()[0], self.rect.centre()[1]];
        figure.group("axes", None, |figure| {
            figure.outline(&self.rect, Pen::new(palette::INK, 1.0));
            self.x_ticks(figure);
            let left = self.y_ticks(figure);
            let below = self.rect.high[1] + TICK_LENGTH + GAP + TICK + GAP + 0.8 * LABEL;
            figure.text(Text::new([across, below], LABEL, &x.label).anchored(Anchor::Middle));
            let label = Text::new([left - GAP - 0.25 * LABEL, up], LABEL, &y.label).anchored(Anchor::Middle);
            figure.text(Text { upwards: true, ..label });
        });
    }

    fn x_ticks(&self, figure: &mut Figure) {
        let bottom = self.rect.high[1];
        let mut free = f64::NEG_INFINITY;
        for tick in self.x.ticks() {
            let x = self.rect.low[0] + self.x.share(tick.value) * self.rect.width();
            figure.line(&[[x, bottom], [x, bottom + length(&tick)]], Pen::new(palette::INK, 1.0));
            let Some(label) = tick.label else { continue };
            let half = 0.5 * font::width(&label, TICK);
            // Labels that would run into each other are left out.
            if x - half >= free {
                free = x + half + GAP;
                let below = bottom + TICK_LENGTH + GAP + 0.75 * TICK;
                figure.text(Text::new([x, below], TICK, label).anchored(Anchor::Middle));
            }
        }
    }

    /// Returns where the labels of ticks begin.
    fn y_ticks(&self, figure: &mut Figure) -> f64 {
        let right = self.rect.low[0];
        let mut widest = 0.0f64;
        for tick in self.y.ticks() {
            let y = self.rect.high[1] - self.y.share(tick.value) * self.rect.height();
            figure.line(&[[right - length(&tick), y], [right, y]], Pen::new(palette::INK, 1.0));
            let Some(label) = tick.label else { continue };
            widest = widest.max(font::width(&label, TICK));
            let at = [right - TICK_LENGTH - GAP + 2.0, y + 0.36 * TICK];
            figure.text(Text::new(at, TICK, label).anchored(Anchor::End));
        }
        right - TICK_LENGTH - GAP - widest
    }
}

fn length(tick: &Tick) -> f64 {
    if tick.label.is_some() { TICK_LENGTH } else { 0.5 * TICK_LENGTH }
}

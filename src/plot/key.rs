//! Keys of figures that are no charts: what marks mean, and a bar of colours.

use super::axis::{Axis, Scale};
use super::canvas::{Anchor, At, Colour, Figure, Pen, Rect, Text, font};
use super::palette;

/// Height of a key's text.
const TEXT: f64 = 10.5;
/// From line to line of a key.
const LINE: f64 = 17.0;
/// Room for a key's sample.
const SAMPLE: f64 = 28.0;

/// What stands beside a key's text.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Sample {
    /// A bit of line.
    Line(Pen),
    /// A disc of a radius, its edge if it has one.
    Disc(f64, Colour, Option<Pen>),
}

/// Draws a key in lines from `at` (its upper left corner), as wide as `width`; returns its height.
pub fn key(figure: &mut Figure, at: At, width: f64, entries: &[(Sample, &str)]) -> f64 {
    let [mut x, mut y] = [at[0], at[1] + 0.5 * LINE];
    figure.group("key", None, |figure| {
        for (sample, text) in entries {
            let needed = SAMPLE + font::width(text, TEXT) + 14.0;
            if x > at[0] && x + needed > at[0] + width {
                (x, y) = (at[0], y + LINE);
            }
            let middle = x + 0.5 * (SAMPLE - 6.0);
            match *sample {
                Sample::Line(pen) => figure.line(&[[x, y], [x + SAMPLE - 6.0, y]], pen),
                Sample::Disc(radius, fill, edge) => figure.disc([middle, y], radius, fill, edge),
            }
            figure.text(Text::new([x + SAMPLE, y + 0.36 * TEXT], TEXT, *text));
            x += needed;
        }
    });
    y + 0.5 * LINE - at[1]
}

/// Steps of a bar of colours: on paper no step shows.
const STEPS: usize = 96;

/// A logarithmic scale of colours over the bulk of some values, and what they measure.
#[derive(Debug, Clone, PartialEq)]
pub struct Colours {
    scale: Scale,
    label: String,
}

impl Colours {
    /// From the 2nd to the 99.5th percentile of the positive values, at most three decades and at least a factor of two.
    pub fn over(mut values: Vec<f64>, label: impl Into<String>) -> Self {
        values.retain(|v| v.is_finite() && *v > 0.0);
        values.sort_by(f64::total_cmp);
        let at = |share: f64| values.get((share * (values.len() as f64 - 1.0)).round() as usize).copied();
        let high = at(0.995).unwrap_or(1.0);
        let low = at(0.02).unwrap_or(0.1).clamp(1e-3 * high, 0.5 * high);
        let scale = Scale::over(&Axis::log("").within(low, high), std::iter::empty(), false);
        Self { scale, label: label.into() }
    }

    /// The colour of a value; those beyond the ends have the ends' colours, and zero the lowest.
    pub fn of(&self, value: f64) -> Colour {
        palette::scale(if value > 0.0 { self.scale.share(value) } else { 0.0 })
    }

    /// Draws an upright bar with ticks to its right.
    pub fn bar(&self, figure: &mut Figure, place: &Rect) {
        figure.group("colours", None, |figure| {
            let step = place.height() / STEPS as f64;
            for k in 0..STEPS {
                let top = place.high[1] - step * (k + 1) as f64;
                // Steps overlap, so that no paper shines through between them.
                let rect = Rect {
                    low: [place.low[0], top],
                    high: [place.high[0], (top + 1.5 * step).min(place.high[1])],
                };
                figure.area(&rect.corners(), palette::scale((k as f64 + 0.5) / STEPS as f64));
            }
            figure.outline(place, Pen::new(palette::INK, 0.8));
            let mut widest = 0.0f64;
            for tick in self.scale.ticks() {
                let y = place.high[1] - self.scale.share(tick.value) * place.height();
                let length = if tick.label.is_some() { 4.0 } else { 2.0 };
                figure.line(&[[place.high[0], y], [place.high[0] + length, y]], Pen::new(palette::INK, 0.8));
                let Some(label) = tick.label else { continue };
                widest = widest.max(font::width(&label, TEXT));
                figure.text(Text::new([place.high[0] + 7.0, y + 0.36 * TEXT], TEXT, label));
            }
            let at = [place.high[0] + 7.0 + widest + 1.6 * TEXT, place.centre()[1]];
            let label = Text::new(at, TEXT, &self.label).anchored(Anchor::Middle);
            figure.text(Text { upwards: true, ..label });
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_span_the_bulk_of_the_values() {
        let colours = Colours::over((1..=1000).map(|k| f64::from(k) * 0.001).collect(), "");
        // Of 1000 even values the 2nd percentile is the 20th or 21st, the 99.5th the 995th.
        let [low, high] = colours.scale.ends();
        assert!((0.019..0.022).contains(&low) && (high - 0.995).abs() < 0.0015, "{low} {high}");
        assert_eq!((colours.of(0.0), colours.of(f64::NAN)), (palette::scale(0.0), palette::scale(0.0)));
        assert_eq!(colours.of(7.0), palette::scale(1.0));
        for values in [vec![], vec![0.0, f64::NAN], vec![3.0]] {
            let [low, high] = Colours::over(values, "").scale.ends();
            assert!(low > 0.0 && high >= 2.0 * low, "{low} {high}");
        }
    }

    #[test]
    fn keys_break_into_lines() {
        let mut figure = Figure::new([300.0, 100.0], "");
        let sample = Sample::Disc(2.0, palette::INK, None);
        let entries = [(sample, "a sample of some length"), (sample, "another sample of some length")];
        assert_eq!(key(&mut figure, [0.0, 0.0], 1000.0, &entries), LINE);
        assert_eq!(key(&mut figure, [0.0, 0.0], 200.0, &entries), 2.0 * LINE);
    }
}

//! Axes: which values they span, where their ticks are, what the ticks say.

/// One axis of a chart.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Axis {
    /// What is measured, and its unit.
    pub label: String,
    /// Equal steps are equal ratios; values that are not positive are left out.
    pub log: bool,
    /// The values at its ends; from the data without it.
    pub range: Option<[f64; 2]>,
}

impl Axis {
    /// An axis of equal steps.
    pub fn linear(label: impl Into<String>) -> Self {
        Self { label: label.into(), ..Self::default() }
    }

    /// An axis of equal ratios.
    pub fn log(label: impl Into<String>) -> Self {
        Self { label: label.into(), log: true, ..Self::default() }
    }

    /// The same from `low` to `high`.
    pub fn within(self, low: f64, high: f64) -> Self {
        Self { range: Some([low, high]), ..self }
    }

    /// Whether the axis has a place for a value.
    pub fn shows(&self, value: f64) -> bool {
        value.is_finite() && (!self.log || value > 0.0)
    }
}

/// A mark on an axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Tick {
    /// Where.
    pub value: f64,
    /// What it says; small ticks say nothing.
    pub label: Option<String>,
}

/// An axis with its ends known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    low: f64,
    high: f64,
    log: bool,
}

/// Ticks that say something, about.
const STEPS: f64 = 6.0;

/// A log axis over more decades than this names some of them only.
const MOST_DECADES: f64 = 8.0;

/// Over less than so many decades ticks are equally spaced: of 1, 2, 5 fewer than two might fall within.
const FEW_DECADES: f64 = 0.9;

impl Scale {
    /// Over values, with room at the ends. Bars stand on zero, or on half the smallest where there is no zero.
    pub fn over(axis: &Axis, values: impl Iterator<Item = f64>, bars: bool) -> Self {
        let log = axis.log;
        if let Some([low, high]) = axis.range.filter(|r| r.iter().all(|&v| axis.shows(v)) && r[0] < r[1]) {
            return Self { low, high, log };
        }
        let (low, high) = values
            .filter(|&v| axis.shows(v))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        if low > high {
            return Self { low: if log { 1.0 } else { 0.0 }, high: if log { 10.0 } else { 1.0 }, log };
        }
        if log { Self::decades(low, high, bars) } else { Self::steps(low, high, bars) }
    }

    fn decades(low: f64, high: f64, bars: bool) -> Self {
        let span = (high / low).log10();
        // One value stands in the middle of a decade.
        let room = 10f64.powf((0.05 * span).max(0.5 * (0.5 - span)));
        Self { low: if bars { 0.5 * low } else { low / room }, high: high * room, log: true }
    }

    fn steps(low: f64, high: f64, bars: bool) -> Self {
        // Zero is shown when it is near: a chart that cuts it off exaggerates.
        let near = |end: f64, other: f64| end > 0.0 && (bars || end < 0.4 * other);
        let (low, high) = if near(low, high) {
            (0.0, high)
        } else if near(-high, -low) {
            (low, 0.0)
        } else {
            (low, high)
        };
        let span = if high > low { high - low } else { (0.2 * high.abs()).max(1.0) };
        let room = |end: f64| {
            if end == 0.0 && high > low { 0.0 } else { 0.05 * span.max(10.0 * (span - (high - low))) }
        };
        Self { low: low - room(low), high: high + room(high), log: false }
    }

    /// The ends.
    pub fn ends(&self) -> [f64; 2] {
        [self.low, self.high]
    }

    /// How far along the axis a value lies: 0 at the low end, 1 at the high.
    pub fn share(&self, value: f64) -> f64 {
        if self.log {
            (value / self.low).ln() / (self.high / self.low).ln()
        } else {
            (value - self.low) / (self.high - self.low)
        }
    }

    /// The axis' ticks, ascending.
    pub fn ticks(&self) -> Vec<Tick> {
        let span = (self.high / self.low).log10();
        if !self.log || span < FEW_DECADES {
            return self.even_ticks();
        }
        let first = self.low.log10().floor() as i32;
        let last = self.high.log10().ceil() as i32;
        let every = if span > MOST_DECADES { (span / 6.0).ceil() as i32 } else { 1 };
        let plain = first >= -4 && last <= 5;
        let mut ticks = Vec::new();
        for decade in first..=last {
            for digit in 1..=if every > 1 { 1 } else { 9 } {
                let value = f64::from(digit) * 10f64.powi(decade);
                let named = if span < 2.0 { [1, 2, 5].contains(&digit) } else { digit == 1 };
                let label =
                    (named && decade.rem_euclid(every) == 0).then(|| decade_label(digit, decade, plain));
                // Ends that are ticks themselves stay despite rounding.
                if value >= self.low * (1.0 - 1e-9) && value <= self.high * (1.0 + 1e-9) {
                    ticks.push(Tick { value, label });
                }
            }
        }
        ticks
    }

    fn even_ticks(&self) -> Vec<Tick> {
        let step = nice((self.high - self.low) / STEPS);
        let slack = 1e-9 * (self.high - self.low);
        let first = ((self.low - slack) / step).ceil() as i64;
        let last = ((self.high + slack) / step).floor() as i64;
        let largest = self.low.abs().max(self.high.abs());
        let tick = |k: i64| {
            let value = k as f64 * step;
            Tick { value, label: Some(even_label(value, step, largest)) }
        };
        (first..=last).map(tick).collect()
    }
}

/// The number of the form 1, 2, 5 × 10ⁿ that is next above.
fn nice(step: f64) -> f64 {
    let decade = 10f64.powf(step.log10().floor());
    let digit = [1.0, 2.0, 5.0, 10.0].into_iter().find(|d| d * decade >= step * (1.0 - 1e-9));
    digit.unwrap_or(10.0) * decade
}

/// A value with the decimals that its step asks for; large and small ones as a power of ten times a number.
fn even_label(value: f64, step: f64, largest: f64) -> String {
    if !(1e-3..1e6).contains(&largest) {
        let power = largest.log10().floor() as i32;
        let unit = 10f64.powi(power);
        let mantissa = even_label(value / unit, step / unit, largest / unit);
        return if value == 0.0 { mantissa } else { format!("{mantissa}×{}", power_of_ten(power)) };
    }
    let decimals = (-step.log10() - 1e-9).ceil().max(0.0) as usize;
    let text = format!("{value:.decimals$}");
    let text = if text.trim_start_matches(['-', '0', '.']).is_empty() { text.replace('-', "") } else { text };
    text.replace('-', "−")
}

fn decade_label(digit: i32, decade: i32, plain: bool) -> String {
    if plain {
        let decimals = (-decade).max(0) as usize;
        return format!("{:.decimals$}", f64::from(digit) * 10f64.powi(decade));
    }
    if digit == 1 { power_of_ten(decade) } else { format!("{digit}×{}", power_of_ten(decade)) }
}

/// "10⁻³"
fn power_of_ten(power: i32) -> String {
    let raised = |c: char| match c {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        digit => char::from_u32('⁰' as u32 + digit as u32 - '0' as u32).unwrap_or(digit),
    };
    std::iter::once("10".to_owned()).chain(power.to_string().chars().map(|c| raised(c).to_string())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(scale: Scale) -> Vec<String> {
        scale.ticks().into_iter().filter_map(|t| t.label).collect()
    }

    fn log(low: f64, high: f64) -> Scale {
        Scale { low, high, log: true }
    }

    fn linear(low: f64, high: f64) -> Scale {
        Scale { low, high, log: false }
    }

    #[test]
    fn linear_ticks_are_round_and_within() {
        assert_eq!(labels(linear(0.0, 1.0)), ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!(labels(linear(-3.0, 7.0)), ["−2", "0", "2", "4", "6"]);
        assert_eq!(labels(linear(0.0, 0.025)), ["0.000", "0.005", "0.010", "0.015", "0.020", "0.025"]);
        assert_eq!(
            labels(linear(0.0, 2.5e7)),
            ["0.0", "0.5×10⁷", "1.0×10⁷", "1.5×10⁷", "2.0×10⁷", "2.5×10⁷"]
        );
        assert_eq!(labels(linear(0.0, 4.0e-5)), ["0", "1×10⁻⁵", "2×10⁻⁵", "3×10⁻⁵", "4×10⁻⁵"]);
    }

    #[test]
    fn log_ticks_are_decades_and_between_them_1_2_5_when_there_are_few() {
        assert_eq!(labels(log(0.01, 10.0)), ["0.01", "0.1", "1", "10"]);
        assert_eq!(labels(log(0.5, 30.0)), ["0.5", "1", "2", "5", "10", "20"]);
        assert_eq!(labels(log(1.0, 1e6)), ["10⁰", "10¹", "10²", "10³", "10⁴", "10⁵", "10⁶"]);
        assert_eq!(labels(log(1e-12, 1e12)).len(), 7);
        assert_eq!(labels(log(2.0, 9.0)), ["2", "4", "6", "8"]);
        let small = log(0.01, 10.0).ticks().iter().filter(|t| t.label.is_none()).count();
        assert_eq!(small, 3 * 8);
    }

    #[test]
    fn ticks_are_at_least_two_and_at_most_a_dozen_over_any_range() {
        // Spans of 0.1 to 12 decades at any place.
        for k in 0..2000 {
            let low = 10f64.powf(f64::from(k % 97) * 0.13 - 6.0);
            let high = low * 10f64.powf(0.1 + 0.006 * f64::from(k));
            for scale in [log(low, high), linear(low, high), linear(-high, low)] {
                let ticks = scale.ticks();
                let count = ticks.iter().filter(|t| t.label.is_some()).count();
                assert!((2..=12).contains(&count), "{count} ticks over {scale:?}");
                assert!(
                    ticks.iter().all(|t| (-1e-6..=1.0 + 1e-6).contains(&scale.share(t.value))),
                    "{scale:?}"
                );
                assert!(ticks.windows(2).all(|w| w[0].value < w[1].value), "{scale:?}");
            }
        }
    }

    #[test]
    fn scales_hold_their_values_with_room() {
        let over = |axis: &Axis, values: &[f64], bars| Scale::over(axis, values.iter().copied(), bars);
        let (line, ratio) = (Axis::linear("a"), Axis::log("b"));
        assert_eq!(over(&line, &[], false).ends(), [0.0, 1.0]);
        assert_eq!(over(&ratio, &[0.0, -1.0, f64::NAN], false).ends(), [1.0, 10.0]);
        for value in [0.0, 5.0, -3.0, 1e9] {
            let [low, high] = over(&line, &[value], false).ends();
            assert!(
                low < value && value < high || value == 0.0 && low <= 0.0 && high > 0.0,
                "{low} {value} {high}"
            );
        }
        let one = over(&ratio, &[7.0], false);
        assert!((one.share(7.0) - 0.5).abs() < 1e-12 && one.ends()[1] / one.ends()[0] < 10.1);
        assert_eq!(over(&line, &[1.0, 10.0], false).ends()[0], 0.0);
        assert!(over(&line, &[9.0, 10.0], false).ends()[0] > 8.0);
        assert_eq!(over(&line, &[9.0, 10.0], true).ends()[0], 0.0);
        assert_eq!(over(&ratio, &[2.0, 100.0], true).ends()[0], 1.0);
        assert_eq!(over(&Axis::log("c").within(1.0, 4.0), &[100.0], false).ends(), [1.0, 4.0]);
        assert_eq!(over(&Axis::log("c").within(0.0, 4.0), &[], false).ends(), [1.0, 10.0]);
    }
}

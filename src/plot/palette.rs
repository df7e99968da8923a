//! Colours: a handful that the colour-blind can tell apart, and a scale from dark to bright.
//!
//! This work is based on: Okabe and Ito, "Color Universal Design", 2008 (the handful, in an order of our own: the most
//! different first, yellow left out because it is too faint on white), and Smith and van der Walt's viridis, 2015 (the
//! scale, evenly bright in steps also without colour).

use super::canvas::Colour;

/// The colours of series.
const SERIES: [Colour; 7] = [
    Colour::new(0x00, 0x72, 0xb2),
    Colour::new(0xd5, 0x5e, 0x00),
    Colour::new(0x00, 0x9e, 0x73),
    Colour::new(0xcc, 0x79, 0xa7),
    Colour::new(0xe6, 0x9f, 0x00),
    Colour::new(0x56, 0xb4, 0xe9),
    Colour::new(0x00, 0x00, 0x00),
];

/// Viridis at eighths.
const SCALE: [[f64; 3]; 9] = [
    [68.0, 1.0, 84.0],
    [71.0, 44.0, 122.0],
    [59.0, 81.0, 139.0],
    [44.0, 113.0, 142.0],
    [33.0, 144.0, 141.0],
    [39.0, 173.0, 129.0],
    [92.0, 200.0, 99.0],
    [170.0, 220.0, 50.0],
    [253.0, 231.0, 37.0],
];

/// Dark text and axes.
pub const INK: Colour = Colour::new(0x22, 0x22, 0x22);
/// Notes, and marks that stand back.
pub const FAINT: Colour = Colour::new(0x66, 0x66, 0x66);
/// The grid behind the data.
pub const GRID: Colour = Colour::new(0xe3, 0xe3, 0xe3);
/// Paper.
pub const PAPER: Colour = Colour::new(0xff, 0xff, 0xff);

/// The colour of the series of this number; they repeat after seven.
pub fn series(number: usize) -> Colour {
    SERIES[number % SERIES.len()]
}

/// Viridis at `share`, clamped to [0, 1]; NaN is the lowest.
pub fn scale(share: f64) -> Colour {
    let place = share.clamp(0.0, 1.0) * 8.0;
    let place = if place.is_nan() { 0.0 } else { place };
    let below = (place as usize).min(7);
    let part = place - below as f64;
    let [red, green, blue] =
        [0, 1, 2].map(|k| (SCALE[below][k] * (1.0 - part) + SCALE[below + 1][k] * part).round() as u8);
    Colour::new(red, green, blue)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scale_runs_from_dark_to_bright() {
        let light =
            |c: Colour| 0.2126 * f64::from(c.red) + 0.7152 * f64::from(c.green) + 0.0722 * f64::from(c.blue);
        for k in 1..=100 {
            assert!(light(scale(f64::from(k) / 100.0)) > light(scale(f64::from(k - 1) / 100.0)) - 0.5, "{k}");
        }
        assert_eq!((scale(-1.0), scale(f64::NAN)), (scale(0.0), scale(0.0)));
        assert_eq!(scale(7.0), Colour::new(253, 231, 37));
    }
}

//! Where errors are, by the program's own estimate.

use super::view::Shot;
use crate::light::mean_channel;
use crate::output::picture::film::Pixel;
use crate::plot::canvas::{Anchor, Colour, Figure, Rect, Text};
use crate::plot::key::{Colours, Sample, key};
use crate::plot::palette;
use crate::solve::Field;

/// The longer side of the picture on the page.
const LONGER: f64 = 480.0;
const MARGIN: f64 = 14.0;
/// Room for the title above and the key below.
const HEAD: f64 = 34.0;
const FOOT: f64 = 46.0;
/// Room for the bar of colours.
const BAR: f64 = 92.0;
/// What has no estimate.
const NOTHING: Colour = Colour::new(0xc8, 0xc8, 0xc8);

/// The error of irradiance over the mean irradiance, in colours.
pub fn figure(field: &Field<'_>, shot: &Shot) -> Figure {
    let place = shot.place([MARGIN, HEAD], LONGER);
    let size = [place.high[0] + BAR, place.high[1] + FOOT];
    let title = "Estimated error";
    let mut figure = Figure::new(size, title);
    let level = f64::from(field.solution.level);
    let share = |pixel: &Pixel| relative(pixel).filter(|_| level > 0.0).map(|error| error / level);
    let values: Vec<f64> = shot.film.pixels.iter().filter_map(share).collect();
    let square = values.iter().map(|v| v * v).sum::<f64>() / values.len().max(1) as f64;
    let colours = Colours::over(values, "standard error of irradiance / mean irradiance");
    let coloured = |pixel: &Pixel| share(pixel).map_or(NOTHING, |value| colours.of(value));
    figure.picture(place, shot.coloured(coloured));
    let low = [place.high[0] + 14.0, place.low[1] + 0.1 * place.height()];
    colours.bar(&mut figure, &Rect::sized(low, [14.0, 0.8 * place.height()]));
    let at = [place.centre()[0], HEAD - 12.0];
    figure.text(Text::new(at, 14.0, title).anchored(Anchor::Middle));
    let told = format!("In this picture {:.2} % of the mean (RMS).", 100.0 * square.sqrt());
    let below = [MARGIN, place.high[1] + 8.0];
    let entries = [(Sample::Disc(5.0, NOTHING, None), "sky, and black surfaces")];
    let height = key(&mut figure, below, place.width(), &entries);
    let at = [MARGIN, below[1] + height + 10.0];
    figure.text(Text::new(at, 10.0, told).coloured(palette::FAINT));
    figure
}

/// The standard error of a pixel's irradiance, W·m⁻², where it sees a surface that reflects.
fn relative(pixel: &Pixel) -> Option<f64> {
    // The film holds the error of radiance, over the surfaces; albedo is over the whole pixel.
    let albedo = f64::from(mean_channel(pixel.albedo)) / f64::from(pixel.coverage);
    (pixel.coverage > 0.0 && albedo > 1e-3).then(|| f64::from(pixel.error) * std::f64::consts::PI / albedo)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn the_error_of_irradiance_comes_back_from_that_of_radiance() {
        // Radiance is albedo / π times irradiance; half the pixel is sky.
        let albedo = 0.4f32;
        let pixel = Pixel {
            albedo: Vec3::splat(0.5 * albedo),
            error: albedo / std::f32::consts::PI * 3.0,
            coverage: 0.5,
            ..Pixel::default()
        };
        assert!((relative(&pixel).unwrap() - 3.0).abs() < 1e-5);
        assert_eq!(relative(&Pixel::default()), None);
    }
}

//! Rows on the hemisphere: what each ray of a receiver met.

use super::{Chosen, length, row};
use crate::geometry::tangent_frame;
use crate::light::mean_channel;
use crate::links::rows::{BLACK, Directions, FIRST_MARK, LOST, SKY, lattice};
use crate::plot::canvas::{Anchor, At, Colour, Figure, Pen, Rect, Text};
use crate::plot::key::{Colours, Sample, key};
use crate::plot::palette;
use crate::solve::Field;

/// The discs' radius.
const RADIUS: f64 = 125.0;
const MARGIN: f64 = 16.0;
/// Room above the discs for titles, below for the key, to the right for colours.
const HEAD: f64 = 70.0;
const FOOT: f64 = 52.0;
const BAR: f64 = 84.0;
/// Share of the disc that dots cover.
const COVERED: f64 = 0.45;
/// Few rays make no larger dots than this.
const LARGEST: f64 = 6.5;

const SKY_COLOUR: Colour = Colour::new(0x9c, 0xd3, 0xf5);
const BLACK_COLOUR: Colour = Colour::new(0x00, 0x00, 0x00);
const LOST_COLOUR: Colour = Colour::new(0xd5, 0x00, 0x32);

/// One disc per receiver, seen against its normal: the middle is overhead, the rim the horizon. Rays that are as dense as
/// the cosine are equally dense there.
pub fn figure(field: &Field<'_>, chosen: &[Chosen]) -> Figure {
    let discs = chosen.len().max(1) as f64;
    let width = MARGIN + discs * (2.0 * RADIUS + MARGIN) + BAR;
    let mut figure = Figure::new([width, HEAD + 2.0 * RADIUS + FOOT], "Rows of receivers");
    figure.text(
        Text::new([0.5 * (width - BAR), 22.0], 14.0, "What the rays of receivers meet")
            .anchored(Anchor::Middle),
    );
    let radiance =
        |site: &u32| f64::from(mean_channel(field.solution.radiosity[*site as usize])) / std::f64::consts::PI;
    let met = chosen.iter().flat_map(|c| row(field, c.receiver).0).filter(|m| **m < FIRST_MARK);
    let colours = Colours::over(met.map(radiance).collect(), "radiance (W·m⁻²·sr⁻¹)");
    for (k, one) in chosen.iter().enumerate() {
        let centre = [MARGIN + RADIUS + k as f64 * (2.0 * RADIUS + MARGIN), HEAD + RADIUS];
        disc(&mut figure, field, (one, centre), &|met| match met {
            SKY => SKY_COLOUR,
            BLACK => BLACK_COLOUR,
            LOST => LOST_COLOUR,
            site => colours.of(radiance(&site)),
        });
    }
    let bar = Rect::sized([width - BAR + 2.0, HEAD + 0.1 * RADIUS], [14.0, 1.8 * RADIUS]);
    colours.bar(&mut figure, &bar);
    let edge = Some(Pen::new(palette::FAINT, 0.4));
    let entries = [
        (Sample::Disc(4.0, palette::scale(0.6), edge), "a site, by its radiance"),
        (Sample::Disc(4.0, SKY_COLOUR, edge), "the sky"),
        (Sample::Disc(4.0, BLACK_COLOUR, edge), "a black back"),
        (Sample::Disc(4.0, LOST_COLOUR, edge), "lost: no site speaks there"),
    ];
    key(&mut figure, [MARGIN, HEAD + 2.0 * RADIUS + 12.0], width - BAR - MARGIN, &entries);
    figure
}

fn disc(
    figure: &mut Figure,
    field: &Field<'_>,
    (chosen, centre): (&Chosen, At),
    colour: &dyn Fn(u32) -> Colour,
) {
    let support = field.problem.receivers.index.supports()[chosen.receiver as usize];
    let (met, key) = row(field, chosen.receiver);
    let title = [
        format!("Receiver {}: {}", chosen.receiver, chosen.reason),
        format!("{} rays, radius {}", met.len(), length(field, support.radius)),
    ];
    for (k, line) in title.iter().enumerate() {
        let at = [centre[0], centre[1] - RADIUS - 25.0 + 13.0 * k as f64];
        figure.text(Text::new(at, 10.0, line).anchored(Anchor::Middle));
    }
    let radius = (RADIUS * (COVERED / met.len().max(1) as f64).sqrt()).min(LARGEST);
    figure.disc(centre, RADIUS, Colour::new(0xf4, 0xf4, 0xf4), Some(Pen::new(palette::INK, 0.8)));
    figure.group("rays", None, |figure| {
        for (place, &met) in places(support.point.normal, key, met.len() as u32).iter().zip(met) {
            let at = [centre[0] + RADIUS * place[0], centre[1] - RADIUS * place[1]];
            figure.disc(at, radius, colour(met), None);
        }
    });
}

/// Where the rays of a row are on the unit disc: along the tangent frame of the receiver's normal.
fn places(normal: glam::Vec3, key: u64, rays: u32) -> Vec<[f64; 2]> {
    let directions = Directions::new(normal, key, rays);
    let (s, t) = tangent_frame(normal);
    let place = |p| {
        let direction = directions.at(p);
        [direction.dot(s), direction.dot(t)].map(f64::from)
    };
    lattice(rays).iter().map(|p| place(*p)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_fill_the_disc_evenly() {
        let rays = 512;
        let places = places(glam::Vec3::new(0.6, 0.0, 0.8), 7, rays);
        let inner = places.iter().filter(|[x, y]| x * x + y * y < 0.5).count() as f64;
        assert!(places.iter().all(|[x, y]| x * x + y * y <= 1.0 + 1e-5));
        // Half the area holds half the rays: a shifted lattice of equal areas errs by one ray at each rim.
        assert!((inner - 256.0).abs() <= 2.0, "{inner}");
    }
}

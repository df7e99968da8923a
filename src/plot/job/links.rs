//! A receiver's links on a picture of the scene.

use super::view::Shot;
use super::{Chosen, length, links_of, row};
use crate::links::rows::{BLACK, LOST, SKY};
use crate::plot::canvas::{Anchor, At, Figure, Pen, Rect, Text};
use crate::plot::key::{Sample, key};
use crate::plot::palette;
use crate::solve::Field;

/// The longer side of the picture on the page.
const LONGER: f64 = 600.0;
const MARGIN: f64 = 14.0;
/// Room for the title above and the key below.
const HEAD: f64 = 34.0;
const FOOT: f64 = 58.0;
/// The radius of the dot of a link with a hundredth of the rays; areas are as weights.
const HUNDREDTH: f64 = 5.0;
/// Dots of the smallest links still show.
const SMALLEST: f64 = 0.9;

/// The picture with a dot for each site that the receiver's row meets.
pub fn figure(field: &Field<'_>, shot: &Shot, shown: Option<&Chosen>) -> Figure {
    let place = shot.place([MARGIN, HEAD], LONGER);
    let title = shown.map_or("Links: the job has no receivers".to_owned(), |c| {
        format!("Links of receiver {} ({})", c.receiver, c.reason)
    });
    let mut figure = Figure::new([place.high[0] + MARGIN, place.high[1] + FOOT], &title);
    figure.picture(place, shot.pale());
    figure.outline(&place, Pen::new(palette::INK, 0.8));
    let at = [place.centre()[0], HEAD - 12.0];
    figure.text(Text::new(at, 14.0, &title).anchored(Anchor::Middle));
    if let Some(chosen) = shown {
        links(&mut figure, field, (shot, &place), chosen.receiver);
    }
    figure
}

/// A link's end in the picture.
struct End {
    at: At,
    radius: f64,
    seen: bool,
}

fn links(figure: &mut Figure, field: &Field<'_>, (shot, place): (&Shot, &Rect), receiver: u32) {
    let sites = field.problem.around.sites;
    let (met, _) = row(field, receiver);
    let links = links_of(met);
    let end = |&(site, count): &(u32, u32)| {
        let position = sites.positions[site as usize];
        let share = f64::from(count) / met.len() as f64;
        let radius = (HUNDREDTH * (100.0 * share).sqrt()).max(SMALLEST);
        let towards = |at| End { at, radius, seen: shot.sees(field, position) };
        shot.at(position, place).map(towards)
    };
    let ends: Vec<End> = links.iter().filter_map(end).collect();
    let support = field.problem.receivers.index.supports()[receiver as usize];
    let own = shot.at(support.point.position, place);
    let [seen, hidden, line] = [palette::series(0), palette::series(4), palette::series(0).veiled(60)];
    let edge = Pen::new(palette::PAPER, 0.5);
    if let Some(own) = own {
        figure.group("links", Some(*place), |f| {
            ends.iter().for_each(|e| f.line(&[own, e.at], Pen::new(line, 0.5)));
        });
    }
    figure.group("sites", Some(*place), |figure| {
        for end in &ends {
            let fill = if end.seen { seen } else { hidden };
            figure.disc(end.at, end.radius, fill.veiled(220), Some(edge));
        }
    });
    let receiver_dot = (palette::series(1), Some(Pen::new(palette::PAPER, 1.5)));
    if let Some(own) = own {
        figure.group("receiver", None, |f| f.disc(own, 6.0, receiver_dot.0, receiver_dot.1));
    }
    let below = [place.low[0], place.high[1] + 6.0];
    let entries = [
        (Sample::Disc(6.0, receiver_dot.0, receiver_dot.1), "the receiver"),
        (Sample::Disc(HUNDREDTH, seen, Some(edge)), "a site with 1 % of the rays"),
        (Sample::Disc(HUNDREDTH, hidden, Some(edge)), "a site that the camera does not see"),
    ];
    let height = key(figure, below, place.width(), &entries);
    let count = |mark: u32| met.iter().filter(|&&m| m == mark).count();
    let told = format!(
        "{} rays meet {} sites ({} outside the picture); sky {}, black {}, lost {}. Radius {}.",
        met.len(),
        links.len(),
        links.len() - ends.len(),
        count(SKY),
        count(BLACK),
        count(LOST),
        length(field, support.radius),
    );
    let at = [place.low[0], below[1] + height + 12.0];
    figure.text(Text::new(at, 10.0, told).coloured(palette::FAINT));
    if !shot.shows_receiver(field, receiver) {
        let told = "The camera does not see the receiver: something is in between, or it looks away.";
        figure.text(Text::new([at[0], at[1] + 13.0], 10.0, told).coloured(palette::FAINT));
    }
}

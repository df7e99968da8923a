//! Some sites with those around them: who neighbours whom, and where walls have cut links.

use rayon::prelude::*;

use super::length;
use super::neighbourhood::{Bond, Neighbourhood, bond};
use crate::plot::canvas::{Anchor, At, Colour, Figure, Pen, Rect, Text};
use crate::plot::key::{Sample, key};
use crate::plot::palette;
use crate::sites::SiteId;
use crate::solve::Field;

/// The panels' width and height.
const PANEL: f64 = 320.0;
const MARGIN: f64 = 14.0;
/// Room above each panel for its title, above all for the figure's, below for the key.
const TITLE: f64 = 30.0;
const HEAD: f64 = 28.0;
const FOOT: f64 = 50.0;
/// How far a panel reaches from its middle, in spacings of the site there.
const REACH: f32 = 5.0;
/// Sites beyond the panel's sides that are triangulated too, so that none of its edges is a hull's.
const BEYOND: f32 = 1.9;

const LINKED: Pen = Pen::new(Colour::new(0x00, 0x72, 0xb2), 1.7);
const CUT: Pen = Pen { colour: Colour::new(0xd5, 0x5e, 0x00), width: 1.7, dash: Some([4.0, 3.0]) };
const APART: Pen = Pen::new(Colour::new(0xbb, 0xbb, 0xbb), 0.8);
const REST: Pen = Pen::new(Colour::new(0x56, 0xb4, 0xe9).veiled(120), 0.6);
const CLEAN: Colour = Colour::new(0x22, 0x22, 0x22);
const UNCLEAN: Colour = Colour::new(0xd5, 0x5e, 0x00);

/// Up to four panels.
pub fn figure(field: &Field<'_>) -> Figure {
    let chosen = chosen(field);
    let columns = chosen.len().clamp(1, 2);
    let rows = chosen.len().div_ceil(2).max(1);
    let width = MARGIN + columns as f64 * (PANEL + MARGIN);
    let height = HEAD + rows as f64 * (PANEL + TITLE) + FOOT;
    let mut figure = Figure::new([width, height], "Neighbourhoods of sites");
    let title = Text::new([0.5 * width, 22.0], 14.0, "Sites and their neighbours, in tangent planes");
    figure.text(title.anchored(Anchor::Middle));
    for (k, (site, reason)) in chosen.iter().enumerate() {
        let low =
            [MARGIN + (k % 2) as f64 * (PANEL + MARGIN), HEAD + TITLE + (k / 2) as f64 * (PANEL + TITLE)];
        panel(&mut figure, field, (*site, reason), &Rect::sized(low, [PANEL, PANEL]));
    }
    if chosen.is_empty() {
        figure.text(Text::new([0.5 * width, 0.5 * height], 14.0, "no sites").anchored(Anchor::Middle));
    }
    let entries = [
        (Sample::Line(LINKED), "linked"),
        (Sample::Line(CUT), "near, but something is in between"),
        (Sample::Line(APART), "too far to be linked"),
        (Sample::Line(REST), "linked, no Delaunay edge"),
        (Sample::Disc(3.0, CLEAN, None), "site"),
        (Sample::Disc(3.0, UNCLEAN, None), "site with a wall near"),
    ];
    key(&mut figure, [MARGIN, height - FOOT + 8.0], width - 2.0 * MARGIN, &entries);
    figure
}

/// The densest, the median and the sparsest site, and the one from which most links are cut.
fn chosen(field: &Field<'_>) -> Vec<(SiteId, String)> {
    let around = field.problem.around;
    let spacing = |s: &u32| around.sites.spacings[*s as usize];
    let mut by_spacing: Vec<u32> = (0..around.sites.len() as u32).collect();
    by_spacing.sort_by(|a, b| spacing(a).total_cmp(&spacing(b)).then(a.cmp(b)));
    let cuts = |s: u32| {
        let mut count = 0u32;
        around.sites.visit_near(around.sites.positions[s as usize], |other| {
            count +=
                u32::from(bond(around.sites, around.graph, [SiteId(s), other]) == Bond::Cut && other.0 != s);
        });
        count
    };
    let unclean = (0..around.sites.len() as u32).into_par_iter().filter(|s| around.graph.unclean(SiteId(*s)));
    let most_cut = unclean.map(|s| (cuts(s), std::cmp::Reverse(s))).max().map(|(_, s)| s.0);
    // Of those of the same spacing the middle one: the first and the last lie in the scene's corners.
    let middle = |rank: usize| {
        let wanted = spacing(by_spacing.get(rank)?);
        let same = |s: &&u32| spacing(s) == wanted;
        let count = by_spacing.iter().filter(same).count();
        by_spacing.iter().filter(same).nth(count / 2).copied()
    };
    let candidates = [
        (middle(0), "Densest"),
        (middle(by_spacing.len() / 2), "Median"),
        (middle(by_spacing.len().saturating_sub(1)), "Sparsest"),
        (most_cut, "Most links cut"),
    ];
    let mut chosen: Vec<(SiteId, String)> = Vec::new();
    for (site, reason) in candidates {
        let Some(site) = site.map(SiteId) else { continue };
        match chosen.iter_mut().find(|c| c.0 == site) {
            Some(known) => known.1 = format!("{}, {}", known.1, reason.to_lowercase()),
            None => chosen.push((site, reason.to_owned())),
        }
    }
    chosen
}

fn panel(figure: &mut Figure, field: &Field<'_>, (site, reason): (SiteId, &str), place: &Rect) {
    let around = field.problem.around;
    let spacing = around.sites.spacings[site.index()];
    let reach = REACH * spacing;
    let hood = Neighbourhood::around(around.sites, site, BEYOND * reach);
    let scale = 0.5 * PANEL / f64::from(reach);
    let at = |k: usize| {
        let [x, y] = hood.sites[k].1;
        [place.centre()[0] + scale * x, place.centre()[1] - scale * y]
    };
    let title = format!("{reason}: site {}, spacing {}", site.0, length(field, spacing));
    let above = [place.centre()[0], place.low[1] - 7.0];
    figure.text(Text::new(above, 11.0, title).anchored(Anchor::Middle));
    let shown = |edge: &&[usize; 2]| touches(place, edge.map(at));
    figure.group("neighbourhood", Some(*place), |figure| {
        let bare = Colour::new(0xf2, 0xf6, 0xfa);
        figure.disc(place.centre(), scale * f64::from(spacing), bare, Some(Pen::new(palette::GRID, 1.0)));
        let rest = rest(field, &hood);
        rest.iter().filter(shown).for_each(|e| figure.line(&e.map(at), REST));
        // Edges that say most lie above.
        for (bond, pen) in [(Bond::Apart, APART), (Bond::Linked, LINKED), (Bond::Cut, CUT)] {
            let of = |edge: &&[usize; 2]| hood.bond(around.sites, around.graph, **edge) == bond;
            hood.edges.iter().filter(shown).filter(of).for_each(|e| figure.line(&e.map(at), pen));
        }
        for (k, (site, _)) in hood.sites.iter().enumerate().filter(|(k, _)| place.grown(4.0).holds(at(*k))) {
            dot(figure, at(k), k == 0, around.graph.unclean(*site));
        }
    });
    figure.outline(place, Pen::new(palette::INK, 0.8));
    ruler(figure, field, place, spacing, scale);
}

/// Whether the box around a line's ends reaches into the panel.
fn touches(place: &Rect, [a, b]: [At; 2]) -> bool {
    (0..2).all(|k| a[k].max(b[k]) >= place.low[k] && a[k].min(b[k]) <= place.high[k])
}

fn dot(figure: &mut Figure, at: At, centre: bool, unclean: bool) {
    let colour = if unclean { UNCLEAN } else { CLEAN };
    let edge = centre.then_some(Pen::new(CLEAN, 1.2));
    if centre {
        figure.disc(at, 6.5, palette::PAPER, edge);
    }
    figure.disc(at, 3.0, colour, None);
}

/// Links of the graph that are no edges of the triangulation.
fn rest(field: &Field<'_>, hood: &Neighbourhood) -> Vec<[usize; 2]> {
    let mut by_site: Vec<(u32, usize)> = hood.sites.iter().enumerate().map(|(k, s)| (s.0.0, k)).collect();
    by_site.sort_unstable();
    let mut edges: Vec<[usize; 2]> = hood.edges.iter().map(|&[a, b]| [a.min(b), a.max(b)]).collect();
    edges.sort_unstable();
    let index = |site: u32| by_site.binary_search_by_key(&site, |s| s.0).ok().map(|i| by_site[i].1);
    let mut rest = Vec::new();
    for (k, (site, _)) in hood.sites.iter().enumerate() {
        let others = field.problem.around.graph.of(*site).iter().filter_map(|&o| index(o));
        rest.extend(others.filter(|&o| o > k).map(|o| [k, o]).filter(|e| edges.binary_search(e).is_err()));
    }
    rest
}

/// A bar as long as the spacing, in the lower left.
fn ruler(figure: &mut Figure, field: &Field<'_>, place: &Rect, spacing: f32, scale: f64) {
    let low = [place.low[0] + 10.0, place.high[1] - 10.0];
    let end = [low[0] + scale * f64::from(spacing), low[1]];
    let label = length(field, spacing);
    let width = crate::plot::canvas::font::width(&label, 10.0);
    let back =
        Rect { low: [low[0] - 5.0, low[1] - 18.0], high: [end[0].max(low[0] + width) + 5.0, low[1] + 5.0] };
    figure.area(&back.corners(), palette::PAPER.veiled(225));
    figure.line(&[low, end], Pen::new(palette::INK, 2.0));
    figure.text(Text::new([low[0], low[1] - 5.0], 10.0, label));
}

//! Figures: charts as SVG and PNG, and `inspect --plot` on a baked job.

#![allow(clippy::unwrap_used)] // a test that cannot go on panics where it stands

mod command;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use command::{Place, code, lines, stderr, stdout};
use glowtree::bake::store::{self, Purpose};
use glowtree::plot::job::neighbourhood::Neighbourhood;
use glowtree::plot::{Axis, Chart, Series, Style};
use glowtree::sites::SiteId;

const FIGURES: [&str; 6] = ["neighbourhoods", "levels", "links", "row", "error_map", "link_levels"];

/// The names of an SVG's tags, after a check that each that opens is closed in its turn.
fn balanced(text: &str) -> Vec<String> {
    let (mut open, mut names) = (Vec::new(), Vec::new());
    for tag in text.split('<').skip(1) {
        let (tag, after) = tag.split_once('>').expect("each tag ends");
        assert!(!after.contains('>') && tag.matches('"').count() % 2 == 0, "{tag}");
        let name: String =
            tag.chars().skip_while(|c| *c == '/').take_while(|c| c.is_alphanumeric()).collect();
        if tag.starts_with('/') {
            assert_eq!(open.pop().as_ref(), Some(&name), "closed in its turn");
            continue;
        }
        if !tag.ends_with('/') {
            open.push(name.clone());
        }
        names.push(name);
    }
    assert!(open.is_empty(), "left open: {open:?}");
    names
}

/// The tags within the groups of a class; groups within count to them.
fn within(text: &str, class: &str) -> Vec<String> {
    let start = format!("<g class=\"{class}\"");
    text.split(&start).skip(1).flat_map(|part| balanced_part(part.split("</g>").next().unwrap())).collect()
}

fn balanced_part(part: &str) -> Vec<String> {
    part.split('<').skip(1).map(|tag| tag.chars().take_while(|c| c.is_alphanumeric()).collect()).collect()
}

fn count(names: &[String], name: &str) -> usize {
    names.iter().filter(|n| *n == name).count()
}

/// The page's size in units of an SVG.
fn size(text: &str) -> [f64; 2] {
    let number = |key: &str| {
        let rest = &text[text.find(key).unwrap() + key.len()..];
        rest[..rest.find('"').unwrap()].parse().unwrap()
    };
    [number(" width=\""), number(" height=\"")]
}

/// Checks that both files hold one page, of two pixels to the unit and several colours.
fn held(stem: &Path) -> String {
    let text = std::fs::read_to_string(stem.with_extension("svg")).unwrap();
    assert_eq!(balanced(&text)[0], "svg");
    // A picture's letters may spell anything.
    let mut plain = text.split("base64,").map(|part| part.split_once('"').map_or(part, |(_, rest)| rest));
    assert!(plain.all(|part| !part.contains("NaN") && !part.contains("inf\"")), "{}", stem.display());
    let picture = image::open(stem.with_extension("png")).unwrap().to_rgb8();
    let [width, height] = size(&text).map(|v| (2.0 * v).round() as u32);
    assert_eq!(picture.dimensions(), (width, height), "{}", stem.display());
    let colours: BTreeSet<[u8; 3]> = picture.pixels().map(|p| p.0).collect();
    assert!(colours.len() > 20, "{}: {} colours", stem.display(), colours.len());
    text
}

#[test]
fn charts_are_written_whole_and_the_same_each_time() {
    let folder = tempfile::tempdir().unwrap();
    let mut chart = Chart::new("Error & cost", Axis::log("seconds"), Axis::log("error"));
    chart.series.push(Series::new("a", Style::LineMarkers, vec![[1.0, 0.1], [10.0, 0.03], [100.0, 0.01]]));
    chart.series.push(Series::new("b <c>", Style::Dashed, vec![[1.0, 0.2], [100.0, 0.02], [0.0, 0.0]]));
    let stem = folder.path().join("chart");
    let files = chart.write(&stem).unwrap();
    assert_eq!(files, [stem.with_extension("svg"), stem.with_extension("png")]);
    let text = held(&stem);
    for label in [
        ">1<",
        ">10<",
        ">100<",
        ">0.01<",
        ">0.1<",
        ">seconds<",
        ">error<",
        ">Error &amp; cost<",
        "1 point of “b",
    ] {
        assert!(text.contains(label), "{label} in {text}");
    }
    // Three markers and the one in the legend.
    assert_eq!(count(&within(&text, "series"), "circle") + count(&within(&text, "legend"), "circle"), 4);
    let first = files.iter().map(|f| std::fs::read(f).unwrap()).collect::<Vec<_>>();
    chart.write(&stem).unwrap();
    assert_eq!(files.iter().map(|f| std::fs::read(f).unwrap()).collect::<Vec<_>>(), first);
    assert_eq!(chart.write(&folder.path().join("no/such")).unwrap_err().exit_code(), 8);
}

#[test]
fn ticks_are_decades_and_a_few_decades_have_more() {
    let labels = |low: f64, high: f64| {
        let mut chart = Chart::new("", Axis::log("").within(low, high), Axis::linear("").within(0.0, 1.0));
        chart.series.push(Series::new("", Style::Line, vec![[low, 0.0], [high, 1.0]]));
        let text = chart.figure().svg();
        text.split("text-anchor=\"middle\"")
            .skip(1)
            .filter_map(|t| t[t.find('>')? + 1..].split('<').next().map(str::to_owned))
            .filter(|t| !t.is_empty())
            .collect::<Vec<_>>()
    };
    assert_eq!(labels(0.01, 100.0), ["0.01", "0.1", "1", "10", "100"]);
    assert_eq!(labels(1.0, 50.0), ["1", "2", "5", "10", "20", "50"]);
    assert_eq!(labels(1.0, 1e6), ["10⁰", "10¹", "10²", "10³", "10⁴", "10⁵", "10⁶"]);
}

/// A room with blocks, baked; and where its figures go.
fn cornell() -> (Place, PathBuf) {
    let place = Place::new();
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/data/cornell/scene.toml");
    let baked = place.run(&["bake", scene, "-o", "job", "--error", "2%", "--no-preview", "-q"]);
    assert_eq!(code(&baked), 0, "{}", stderr(&baked));
    let plots = place.path("plots");
    (place, plots)
}

#[test]
fn a_job_is_drawn() {
    let (place, plots) = cornell();
    let output = place.run(&["--json", "inspect", "job", "--plot", "plots"]);
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    let summary = lines(&output).pop().unwrap();
    let told: Vec<&str> = summary["plots"].as_array().unwrap().iter().map(|f| f.as_str().unwrap()).collect();
    assert_eq!(told.len(), 2 * FIGURES.len());
    let texts = FIGURES.map(|name| {
        assert!(
            ["svg", "png"].iter().all(|end| told.contains(&format!("plots/{name}.{end}").as_str())),
            "{told:?}"
        );
        held(&plots.join(name))
    });
    let [hoods, levels, links, row, error_map, link_levels] = &texts;

    let model = store::read(&place.path("job"), Purpose::Light).unwrap();
    let receivers = summary["plotted_receivers"].as_array().unwrap();
    // Figures must do with rows of both lengths.
    assert!(!model.receivers.own.is_empty());
    let rays = |receiver: &serde_json::Value| {
        let (rows, r) = model.receivers.row(receiver.as_u64().unwrap() as usize);
        rows.row(r).len()
    };
    assert_eq!(count(&within(row, "rays"), "circle"), receivers.iter().map(rays).sum::<usize>());
    let lines_of_links = count(&within(links, "links"), "polyline");
    let dots = count(&within(links, "sites"), "circle");
    assert!(lines_of_links > 15 && lines_of_links == dots, "{lines_of_links} {dots}");
    // A panel each; within 5 spacings lie at least a dozen sites on a flat wall.
    let hood = within(hoods, "neighbourhood");
    assert!(count(&hood, "circle") > 4 * 12 && count(&hood, "polyline") > 4 * 24, "{hood:?}");
    assert!(hoods.contains("stroke-dasharray=\"4 3\""), "blocks on a floor cut links");
    assert!(count(&balanced(levels), "polygon") > 4 && count(&balanced(link_levels), "polygon") > 8);
    assert!(count(&balanced(error_map), "image") == 1 && count(&balanced(links), "image") == 1);

    every_triangle_is_empty(&model.sites, &[0, model.sites.len() as u32 / 2]);
    once_more_with_a_receiver(&place, &plots);
}

/// Checks neighbourhoods of a job's sites against the definition of Delaunay.
fn every_triangle_is_empty(sites: &glowtree::sites::Sites, around: &[u32]) {
    for &centre in around {
        let reach = 9.0 * sites.spacings[centre as usize];
        let hood = Neighbourhood::around(sites, SiteId(centre), reach);
        assert!(hood.sites.len() > 30 && !hood.triangles.is_empty(), "{} sites", hood.sites.len());
        // Lengths in spacings: squares of up to 18 spacings err by 18⁴ · 2⁻⁵², about 2e-11.
        let unit = f64::from(sites.spacings[centre as usize]);
        let at = |k: usize| hood.sites[k].1.map(|v| v / unit);
        for triangle in &hood.triangles {
            let deepest = (0..hood.sites.len())
                .filter(|k| !triangle.contains(k))
                .map(|k| in_circle(triangle.map(at), at(k)))
                .fold(f64::NEG_INFINITY, f64::max);
            assert!(deepest < 2e-10, "{triangle:?} around site {centre}: {deepest}");
        }
        // The test can fail: a corner moved through its opposite side's circle is noticed.
        let [a, b, c] = hood.triangles[0].map(at);
        let middle = [0, 1].map(|k| (a[k] + b[k] + c[k]) / 3.0);
        assert!(in_circle([a, b, c], middle) > 1e-3);
    }
}

/// The determinant that is positive when `d` lies within the circle through a, b, c (counter-clockwise).
fn in_circle([a, b, c]: [[f64; 2]; 3], d: [f64; 2]) -> f64 {
    let row = |p: [f64; 2]| {
        let (x, y) = (p[0] - d[0], p[1] - d[1]);
        [x, y, x * x + y * y]
    };
    let [p, q, r] = [row(a), row(b), row(c)];
    p[0] * (q[1] * r[2] - q[2] * r[1]) - p[1] * (q[0] * r[2] - q[2] * r[0])
        + p[2] * (q[0] * r[1] - q[1] * r[0])
}

fn once_more_with_a_receiver(place: &Place, plots: &Path) {
    let before = std::fs::read(plots.join("levels.png")).unwrap();
    let output = place.run(&["inspect", "job", "--plot", "plots", "--receiver", "3", "--progress", "none"]);
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    assert!(stdout(&output).contains("plots/row.svg\n"), "{}", stdout(&output));
    assert!(std::fs::read_to_string(plots.join("row.svg")).unwrap().contains(">Receiver 3: as asked<"));
    assert_eq!(std::fs::read(plots.join("levels.png")).unwrap(), before, "the same job, the same bytes");

    let output = place.run(&["inspect", "job", "--plot", "plots", "--receiver", "4000000000"]);
    assert_eq!(code(&output), 2);
    assert!(stderr(&output).contains("no receiver 4000000000; it has 0 to "), "{}", stderr(&output));
}

#[test]
fn folders_that_cannot_be_written_are_named() {
    let place = Place::new();
    place.baked("job");
    for (words, expected, part) in [
        (&["inspect", "job", "--plot", "scene.toml"][..], 8, "scene.toml"),
        (&["inspect", "job", "--plot", "scene.toml/plots"], 8, "scene.toml/plots"),
        (&["inspect", "nowhere", "--plot", "plots"], 10, "nowhere"),
        (&["inspect", "job", "--receiver", "1"], 2, "--plot"),
    ] {
        let output = place.run(words);
        assert_eq!(code(&output), expected, "{words:?}: {}", stderr(&output));
        assert!(stderr(&output).contains(part) && output.stdout.is_empty(), "{words:?}: {}", stderr(&output));
    }
    assert!(!place.path("plots").exists(), "nothing is made for a job that is not there");
    // The folder is made where it is missing; a scene under the sky has rows that leave it.
    let output = place.run(&["inspect", "job", "--plot", "new/plots", "-q"]);
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    assert!(output.stdout.is_empty() && place.path("new/plots/row.png").is_file());
}

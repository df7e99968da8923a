//! `probe` and `reference` through the program: closed forms, columns, streams.

#![allow(clippy::unwrap_used)] // a test that cannot go on panics where it stands

mod command;

use std::path::Path;

use command::{Place, code, lines, stderr, stdout};

/// The furnace of `data/`: exitance π and albedo ρ on every surface, so that B = H = π / (1 − ρ) everywhere.
const FURNACE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/data/furnace/scene.toml");
const ALBEDO: [f64; 3] = [0.5, 0.7, 0.9];

/// Points on all sides of the furnace's room, |x|, |y|, |z| ≤ 1, with two columns of someone else's.
fn on_the_room() -> String {
    let mut text = "id,x,y,z,nx,ny,nz,note\n".to_owned();
    for side in 0..6 {
        for k in 0..20 {
            let (u, v) = (-0.95 + 0.1 * f64::from(k), -0.9 + 0.17 * f64::from((7 * k + side) % 11));
            let (axis, sign) = (side as usize / 2, if side % 2 == 0 { 1.0 } else { -1.0 });
            let (mut at, mut normal) = ([0.0; 3], [0.0; 3]);
            (at[axis], at[(axis + 1) % 3], at[(axis + 2) % 3], normal[axis]) = (sign, u, v, -sign);
            let [x, y, z] = at;
            let [nx, ny, nz] = normal;
            text += &format!("{side}-{k:03},{x},{y},{z},{nx},{ny},{nz},\"a, \"\"b\"\"\"\n");
        }
    }
    text
}

/// The last `count` columns of each row, as numbers.
fn results(table: &str, count: usize) -> Vec<Vec<f64>> {
    let numbers = |row: &str| {
        let mut last: Vec<f64> = row.rsplit(',').take(count).map(|field| field.parse().unwrap()).collect();
        last.reverse();
        last
    };
    table.lines().skip(1).map(numbers).collect()
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap()
}

/// A place with the furnace baked into `job` and `room.csv` on its walls.
fn furnace() -> Place {
    let place = Place::new();
    let output = place.run(&["bake", FURNACE, "-o", "job", "--error", "10%", "--no-preview", "-q"]);
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    std::fs::write(place.path("room.csv"), on_the_room()).unwrap();
    place
}

#[test]
fn a_probed_furnace_is_exact() {
    let place = furnace();
    let output = place.run(&["probe", "job", "--points", "room.csv", "-o", "out.csv", "--json"]);
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    let summary = lines(&output).pop().unwrap();
    assert_eq!((summary["verb"].as_str(), summary["points"].as_u64()), (Some("probe"), Some(120)));
    let table = read(&place.path("out.csv"));
    assert_eq!(
        table.lines().next().unwrap(),
        "id,x,y,z,nx,ny,nz,note,irradiance_r,irradiance_g,irradiance_b,radiosity_r,radiosity_g,radiosity_b,error"
    );
    for (row, input) in table.lines().zip(on_the_room().lines()) {
        assert!(row.starts_with(input), "{row}: the input's columns stay to the letter: {input}");
    }
    for (row, values) in results(&table, 7).iter().enumerate() {
        for (channel, albedo) in ALBEDO.iter().enumerate() {
            let exact = std::f64::consts::PI / (1.0 - albedo);
            // The solver stops at a relative residual of 1e-5, which all further bounces would repeat ρ/(1 − ρ) times;
            // sums of some hundred single-precision terms add 1e-6 or so.
            let tolerance = 1e-5 + 1e-5 * albedo / (1.0 - albedo);
            for (what, value) in [("irradiance", values[channel]), ("radiosity", values[3 + channel])] {
                let off = value / exact - 1.0;
                assert!(
                    off.abs() < tolerance,
                    "row {row}: {what} {channel}: {value}, exactly {exact}: {off:e}"
                );
            }
        }
    }
}

#[test]
fn backs_and_points_in_the_air_have_no_radiosity() {
    let place = furnace();
    // The room's walls look inwards; (0.9, 0.9, 0.9) is a tenth of the room away from any wall.
    let text = "x,y,z,nx,ny,nz\n1,0.3,0.2,1,0,0\n0.9,0.9,0.9,0,1,0\n";
    std::fs::write(place.path("odd.csv"), text).unwrap();
    let output = place.run(&["probe", "job", "--points", "odd.csv"]);
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    assert!(stderr(&output).contains("1 points lie farther"), "{}", stderr(&output));
    let values = results(&stdout(&output), 7);
    assert_eq!((&values[0][3..6], &values[1][3..6]), (&[0.0; 3][..], &[0.0; 3][..]));
    // Outside it is dark. In the air the furnace's light arrives from all sides, and every ray meets the same: only the
    // solver's residual of 1e-5 shows.
    assert_eq!(values[0][..3], [0.0; 3]);
    let exact = std::f64::consts::PI / (1.0 - ALBEDO[0]);
    assert!((values[1][0] / exact - 1.0).abs() < 2e-5, "{} against {exact}", values[1][0]);
}

#[test]
fn standard_output_gets_the_same_bytes_as_a_file() {
    let place = furnace();
    assert_eq!(code(&place.run(&["probe", "job", "--points", "room.csv", "-o", "out.csv", "-q"])), 0);
    let file = read(&place.path("out.csv"));
    for words in
        [&["probe", "job", "--points", "room.csv"][..], &["probe", "job", "--points", "room.csv", "-o", "-"]]
    {
        assert_eq!(stdout(&place.run(words)), file, "{words:?}");
    }
    // Answers do not depend on threads, and a table that holds answers gets fresh ones in their place.
    let one = place.run(&["probe", "job", "--points", "out.csv", "-j", "1"]);
    assert_eq!(stdout(&one), file);
    let both = place.run(&["probe", "job", "--points", "room.csv", "--json"]);
    assert_eq!(code(&both), 2, "JSON lines and a table cannot share standard output");
}

#[test]
fn the_reference_agrees_with_the_furnace_within_its_own_error() {
    let place = furnace();
    let words = [
        "reference",
        FURNACE,
        "--points",
        "room.csv",
        "--spp",
        "64",
        "--seed",
        "3",
        "-o",
        "out.csv",
        "--json",
    ];
    let output = place.run(&words);
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    assert_eq!(lines(&output).pop().unwrap()["points"].as_u64(), Some(120));
    let table = read(&place.path("out.csv"));
    assert!(
        table
            .lines()
            .next()
            .unwrap()
            .ends_with(",note,irradiance_r,irradiance_g,irradiance_b,stderr_r,stderr_g,stderr_b")
    );
    hold(&table, ALBEDO.map(|albedo| std::f64::consts::PI / (1.0 - albedo)));
    let shallow = place.run(&[&words[..], &["--max-bounces", "0"]].concat());
    assert_eq!(code(&shallow), 0, "{}", stderr(&shallow));
    // Without reflections only what the surfaces emit arrives.
    hold(&read(&place.path("out.csv")), [std::f64::consts::PI; 3]);
}

/// Holds the mean irradiance over all rows to `exact`, by the standard errors that the table claims.
fn hold(table: &str, exact: [f64; 3]) {
    let rows = results(table, 6);
    let count = rows.len() as f64;
    for (channel, exact) in exact.into_iter().enumerate() {
        let mean = rows.iter().map(|row| row[channel]).sum::<f64>() / count;
        let error = rows.iter().map(|row| row[3 + channel].powi(2)).sum::<f64>().sqrt() / count;
        assert!(error > 0.0 && error < 0.02 * exact, "seed 3, channel {channel}: {error} of {exact}");
        // Four standard errors of the mean of 120 independent points.
        assert!(
            (mean - exact).abs() < 4.0 * error,
            "seed 3, channel {channel}: {mean} ± {error} against {exact}"
        );
    }
}

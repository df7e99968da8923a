//! The stability suite, a test a row: every number of the program's within its limit, none of the textbook's scheme.

use glam::DVec3;
use glowtree::bake::Silent;
use glowtree::bake::pipeline::{self, Target};
use glowtree::basis::Basis;
use glowtree::compare::known;
use glowtree::compare::stability::{self, Measured, Row, report};
use glowtree::light::mean_channel;
use glowtree::links::points::Operator;

/// Measures a row, prints its numbers and asserts that it holds; where there is a textbook scheme, that it does not.
fn holds(number: usize) {
    let row: Row = stability::row(number, &Silent).expect("nothing interrupts");
    let show = |m: &Measured| {
        let (value, limit) = (report::shown(m.value, m.unit), report::shown(m.limit, m.unit));
        println!("  {}: {value}, limit {limit}", m.what);
    };
    println!("row {number}, {}", row.case);
    row.ours.iter().for_each(show);
    println!(" textbook: {}", row.scheme.unwrap_or("none"));
    row.textbook.iter().for_each(show);
    assert_eq!(row.scheme.is_some(), !row.textbook.is_empty());
    assert!(row.scheme.is_none() || row.textbook.iter().any(|m| !m.holds()), "the textbook scheme holds too");
    let open = |m: &&Measured| OPEN.iter().any(|o| (o.0, o.1) == (number, m.what.as_str()) && m.value <= o.2);
    let broken = row.ours.iter().filter(|m| !m.holds()).any(|m| !open(&m));
    assert!(!broken && !row.ours.is_empty(), "{}", report::text(&row));
}

/// What does not hold yet (row, number, value that it must not exceed): the verb says FAIL, and docs/stability.md why.
const OPEN: [(usize, &str, f64); 1] = [(12, "blocks through each other: contrast of flat parts", 0.03)];

/// The sabotage of row 16, which has no textbook scheme: at a tenth of the accuracy two seeds differ by more than its limit.
#[test]
fn two_seeds_differ_where_the_target_is_loose() {
    let walls = known::cuboid(DVec3::ZERO, DVec3::ONE, 3).flipped();
    let block = known::cuboid(DVec3::new(0.6, 0.5, 0.0), DVec3::new(0.8, 0.75, 0.6), 3);
    let lamp = known::quad(DVec3::new(0.4, 0.35, 0.98), DVec3::Y * 0.25, DVec3::X * 0.25, 3);
    let parts = [
        known::part("walls", walls, 0.7),
        known::part("block", block, 0.5),
        known::part("lamp", lamp, 0.0).exitance(10.0),
    ];
    let scene = known::scene(&parts);
    let points = known::points_on(&scene, 0, 1500, 29);
    let [one, other] = [1, 2].map(|seed| {
        let target = Target {
            error: 0.2,
            seed,
            bounces: None,
            basis: Basis::default(),
            operator: Operator::default(),
            relightable: false,
        };
        let (model, ..) = pipeline::reach(&scene, &target, &Silent).expect("nothing interrupts");
        let answers = model.field().evaluate(&points);
        answers.iter().map(|a| f64::from(mean_channel(a.total()))).collect::<Vec<_>>()
    });
    let square: f64 = one.iter().zip(&other).map(|(a, b)| (a - b).powi(2)).sum();
    let apart = (square / one.len() as f64).sqrt() / (one.iter().sum::<f64>() / one.len() as f64);
    println!("two seeds at 20 %: {:.2} % apart", 100.0 * apart);
    assert!(apart > 0.02, "{apart}");
}

macro_rules! rows {
    ($($name:ident: $number:literal,)*) => {
        $(
            #[test]
            fn $name() {
                holds($number);
            }
        )*

        #[test]
        fn every_row_has_a_test() {
            assert_eq!([$($number),*].len(), stability::COUNT);
        }
    };
}

rows! {
    row_01_squares_near_and_far: 1,
    row_02_furnace: 2,
    row_03_products: 3,
    row_04_crease: 4,
    row_05_thin_wall: 5,
    row_06_common_floor: 6,
    row_07_table_leg: 7,
    row_08_tiny_emitter: 8,
    row_09_sweep: 9,
    row_10_broken_triangles: 10,
    row_11_scale_and_offset: 11,
    row_12_coincident: 12,
    row_13_speck: 13,
    row_14_open: 14,
    row_15_retessellated: 15,
    row_16_reordered: 16,
    row_17_refused: 17,
}

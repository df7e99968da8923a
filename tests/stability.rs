//! The stability suite, a test a row: every number of the program's within its limit, none of the textbook's scheme.

use glowtree::bake::Silent;
use glowtree::compare::stability::{self, Measured, Row, report};

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
    assert!(row.holds && !row.ours.is_empty(), "{}", report::text(&row));
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

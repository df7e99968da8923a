//! Broken tables of points.

use crate::{Ask, Case};

/// Whole tables.
const TABLES: &[(&str, &str)] = &[
    ("empty", ""),
    ("line-ends-only", "\n\r\n\n"),
    ("blanks-only", "   \n"),
    ("header-alone", "x,y,z,nx,ny,nz\n"),
    ("header-missing", "0,0,0,0,0,1\n"),
    ("header-with-semicolons", "x;y;z;nx;ny;nz\n0;0;0;0;0;1\n"),
    ("header-with-tabs", "x\ty\tz\tnx\tny\tnz\n0\t0\t0\t0\t0\t1\n"),
    ("header-in-capitals", "X,Y,Z,NX,NY,NZ\n0,0,0,0,0,1\n"),
    ("column-x-missing", "y,z,nx,ny,nz\n0,0,0,0,1\n"),
    ("normals-missing", "x,y,z\n0,0,0\n"),
    ("column-twice", "x,y,z,nx,ny,nz,x\n0,0,0,0,0,1,5\n"),
    ("column-named-with-line-ends", "\"x\ny\",z\n0,0\n"),
    ("column-named-with-escape-codes", "\u{1b}[2J,z\n0,0\n"),
    ("column-of-10000-letters", "LONG,z\n0,0\n"),
    ("header-of-10000-columns", "WIDE\n"),
    ("quote-unclosed", "x,y,z,nx,ny,nz\n0,0,\"0,0,0,1\n0,0,0,0,0,1\n"),
    ("a-ply", "ply\nformat ascii 1.0\n"),
    ("json", "{\"x\": [0], \"y\": [0]}\n"),
];

/// Rows under a good header and a good row.
const ROWS: &[(&str, &str)] = &[
    ("row-too-short", "0,0,0,0,0"),
    ("row-too-long", "0,0,0,0,0,1,7"),
    ("row-blank", "   "),
    ("number-missing", "0,0,,0,0,1"),
    ("number-a-word", "0,zero,0,0,0,1"),
    ("number-with-a-unit", "0m,0,0,0,0,1"),
    ("number-hexadecimal", "0x10,0,0,0,0,1"),
    ("number-with-decimal-comma", "\"0,5\",0,0,0,0,1"),
    ("number-of-10000-digits", "LONG,0,0,0,0,1"),
    ("number-with-escape-codes", "\u{1b}[2J,0,0,0,0,1"),
    ("number-with-line-ends", "\"1\n2\",0,0,0,0,1"),
    ("position-nan", "nan,0,0,0,0,1"),
    ("position-infinite", "0,-inf,0,0,0,1"),
    ("position-beyond-single", "0,0,1e39,0,0,1"),
    ("position-beyond-double", "0,0,1e999,0,0,1"),
    ("normal-nan", "0,0,0,0,nan,1"),
    ("normal-zero", "0,0,0,0,0,0"),
    ("normal-minus-zero", "0,0,0,-0,-0.0,0"),
    ("normal-infinite", "0,0,0,0,0,inf"),
    ("normal-too-small-for-doubles", "0,0,0,0,0,1e-999"),
    ("zero-byte", "0,0,0\0,0,0,1"),
];

/// All of them.
pub fn cases() -> Vec<Case> {
    let point =
        |name: &str, bytes: Vec<u8>| Case::new(&format!("points/{name}"), "bad.csv", bytes, Ask::Points);
    let wide = (0..10_000).map(|k| format!("c{k}")).collect::<Vec<_>>().join(",");
    let fill = |text: &str| text.replace("WIDE", &wide).replace("LONG", &"7x".repeat(5_000));
    let tables = TABLES.iter().map(|(name, text)| point(name, fill(text).into()));
    let rows = ROWS
        .iter()
        .map(|(name, row)| point(name, fill(&format!("x,y,z,nx,ny,nz\n0,0,0,0,0,1\n{row}\n")).into()));
    let utf16: Vec<u8> = "x,y,z,nx,ny,nz\n0,0,0,0,0,1\n".encode_utf16().flat_map(u16::to_le_bytes).collect();
    let others = [
        point("header-not-utf-8", b"x,y,z,nx,ny,nz,h\xf6he\n0,0,0,0,0,1,2\n".to_vec()),
        point("row-not-utf-8", b"x,y,z,nx,ny,nz,name\n0,0,0,0,0,1,h\xf6he\n".to_vec()),
        point("in-utf-16", utf16),
        point("carriage-returns-only", b"x,y,z,nx,ny,nz\r0,0,0,0,0,1\r1,1,1,0,0\r".to_vec()),
        point("line-of-8-mebibytes", {
            let mut bytes = b"x,y,z,nx,ny,nz\n".to_vec();
            bytes.resize(8 << 20, b'1');
            bytes
        }),
        point("zeros", vec![0; 5000]),
        Case::missing("points/missing-file", "gone.csv", Ask::Points),
        Case::missing("points/a-folder", ".", Ask::Points),
    ];
    tables.chain(rows).chain(others).collect()
}

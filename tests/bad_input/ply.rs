//! Broken PLY meshes.

use crate::{Case, scene, scene_shared::SQUARE_PLY};

/// Squares with one text replaced: name, what is there, what stands there instead.
const SQUARES: &[(&str, &str, &str)] = &[
    ("magic-in-capitals", "ply\n", "PLY\n"),
    ("magic-missing", "ply\n", ""),
    ("byte-order-mark", "ply\n", "\u{feff}ply\n"),
    ("format-misspelt", "format ascii", "format ascci"),
    ("format-missing", "format ascii 1.0\n", ""),
    ("format-without-word", "format ascii 1.0", "format"),
    ("format-twice", "format ascii 1.0\n", "format ascii 1.0\nformat binary_little_endian 1.0\n"),
    ("format-version-2", "ascii 1.0", "ascii 2.0"),
    ("format-escape-codes", "format ascii", "format \u{1b}[31mascii"),
    ("element-without-count", "element vertex 4", "element vertex"),
    ("element-with-too-many-words", "element vertex 4", "element vertex 4 4"),
    ("vertices-negative", "element vertex 4", "element vertex -4"),
    ("vertices-fractional", "element vertex 4", "element vertex 4.5"),
    ("vertices-zero", "element vertex 4", "element vertex 0"),
    ("vertices-1e12", "element vertex 4", "element vertex 1000000000000"),
    ("vertices-2e64-less-1", "element vertex 4", "element vertex 18446744073709551615"),
    ("vertices-2e64", "element vertex 4", "element vertex 18446744073709551616"),
    ("vertices-one-too-many", "element vertex 4", "element vertex 5"),
    ("vertices-one-too-few", "element vertex 4", "element vertex 3"),
    ("vertex-element-misnamed", "element vertex 4", "element points 4"),
    ("vertex-element-name-of-control-characters", "element vertex 4", "element \u{7}\u{8} 4"),
    ("vertex-element-without-property", "element vertex 4\n", "element vertex 4\nelement other 4\n"),
    ("vertex-element-twice", "element face 1", "element vertex 1\nproperty float w\nelement face 1"),
    (
        "face-element-twice",
        "end_header",
        "element face 1\nproperty list uchar int vertex_indices\nend_header",
    ),
    (
        "element-after-face-truncated",
        "end_header",
        "element edge 9\nproperty int a\nproperty int b\nend_header",
    ),
    ("element-of-nothing-4e9-times", "element vertex 4\n", "element void 4000000000\nelement vertex 4\n"),
    ("keyword-misspelt", "property float x", "propety float x"),
    ("property-before-element", "element vertex 4", "property float x\nelement vertex 4"),
    ("property-of-no-type", "property float x", "property real x"),
    ("property-without-name", "property float x", "property float"),
    ("property-x-missing", "property float x", "property float q"),
    ("property-x-twice", "property float y", "property float x"),
    ("property-x-a-list", "property float x", "property list uchar float x"),
    ("list-counted-by-floats", "list uchar int", "list float int"),
    ("list-of-float-indices", "list uchar int", "list uchar float"),
    ("list-misnamed", "vertex_indices", "corners"),
    ("list-a-scalar", "list uchar int vertex_indices", "int vertex_indices"),
    ("faces-zero", "element face 1", "element face 0"),
    ("faces-one-too-many", "element face 1", "element face 2"),
    ("faces-4e9", "element face 1", "element face 4000000000"),
    ("faces-misnamed", "element face 1", "element polygon 1"),
    ("end-of-header-missing", "end_header\n", ""),
    ("end-of-header-misspelt", "end_header", "end_of_header"),
    ("position-nan", "1 1 0\n", "1 nan 0\n"),
    ("position-inf", "1 1 0\n", "inf 1 0\n"),
    ("position-beyond-double", "1 1 0\n", "1 1 -1e999\n"),
    ("position-a-word", "1 1 0\n", "1 one 0\n"),
    ("position-with-decimal-comma", "1 1 0\n", "1,0 1,0 0,0\n"),
    ("position-of-two-numbers", "1 1 0\n", "1 1\n"),
    ("position-not-utf-8", "1 1 0\n", "1 1 \u{fc}\n"),
    ("position-with-a-word-of-10000-letters", "1 1 0\n", "LONG"),
    ("positions-all-the-same", "1 0 0\n1 1 0\n0 1 0\n", "0 0 0\n0 0 0\n0 0 0\n"),
    ("positions-in-line", "1 0 0\n1 1 0\n0 1 0\n", "1 1 1\n2 2 2\n3 3 3\n"),
    ("positions-1e308-apart", "1 0 0\n1 1 0\n0 1 0\n", "1e308 0 0\n-1e308 1 0\n0 1 0\n"),
    ("positions-1e-310-apart", "1 0 0\n1 1 0\n0 1 0\n", "1e-310 0 0\n1e-310 1e-310 0\n0 1e-310 0\n"),
    ("index-of-no-vertex", "4 0 1 2 3", "4 0 1 2 4"),
    ("index-negative", "4 0 1 2 3", "4 0 1 2 -1"),
    ("index-2e32", "4 0 1 2 3", "4 0 1 2 4294967296"),
    ("index-fractional", "4 0 1 2 3", "4 0 1 2 1.5"),
    ("index-a-word", "4 0 1 2 3", "4 0 1 two 3"),
    ("index-nan", "4 0 1 2 3", "4 0 1 2 nan"),
    ("list-length-negative", "4 0 1 2 3", "-4 0 1 2 3"),
    ("list-length-4e9", "4 0 1 2 3", "4000000000 0 1 2 3"),
    ("list-length-beyond-integers", "4 0 1 2 3", "1e300 0 1 2 3"),
    ("list-length-nan", "4 0 1 2 3", "nan 0 1 2 3"),
    ("list-shorter-than-said", "4 0 1 2 3", "5 0 1 2 3"),
    ("list-longer-than-said", "4 0 1 2 3", "3 0 1 2 3"),
    ("face-of-two-corners", "4 0 1 2 3", "2 0 1"),
    ("face-of-one-corner-repeated", "4 0 1 2 3", "3 0 0 0"),
    ("face-that-crosses-itself", "4 0 1 2 3", "4 0 2 1 3"),
    ("face-missing", "4 0 1 2 3\n", ""),
    ("row-after-the-last", "4 0 1 2 3\n", "4 0 1 2 3\n3 0 1 2\n"),
    (
        "colour-nan",
        "property float z\n",
        "property float z\nproperty float red\nproperty float green\nproperty float blue\n",
    ),
    ("escape-codes-in-a-row", "1 1 0\n", "1 \u{1b}[2J 0\n"),
];

/// The header of a binary triangle.
fn header(format: &str, vertices: &str, faces: &str) -> String {
    format!(
        "ply\nformat {format} 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {faces}\nproperty list int int vertex_indices\nend_header\n"
    )
}

/// A little-endian triangle with this header and this list.
fn binary(head: String, list: &[i32]) -> Vec<u8> {
    let mut bytes = head.into_bytes();
    [0f32, 0., 0., 1., 0., 0., 0., 1., 0.].iter().for_each(|f| bytes.extend(f.to_le_bytes()));
    list.iter().for_each(|i| bytes.extend(i.to_le_bytes()));
    bytes
}

fn binaries() -> Vec<Case> {
    let head = |vertices: &str, faces: &str| header("binary_little_endian", vertices, faces);
    let sound = binary(head("3", "1"), &[3, 0, 1, 2]);
    let body = sound.len() - 52;
    let set = |at: usize, value: f32| {
        let mut bytes = sound.clone();
        bytes[body + at..body + at + 4].copy_from_slice(&value.to_le_bytes());
        bytes
    };
    let strips = |list: &[i32]| binary(head("3", "1").replace("element face", "element tristrips"), list);
    let mixed = head("3", "1").replace("property list", "property list uchar int more\nproperty list");
    let chars = "ply\nformat binary_little_endian 1.0\nelement vertex 1000000000000\nproperty char x\nproperty char y\n\
                 property char z\nend_header\n";
    let cases: Vec<(&str, Vec<u8>)> = vec![
        ("binary-cut-in-the-vertices", sound[..body + 20].to_vec()),
        ("binary-cut-in-the-list", sound[..sound.len() - 3].to_vec()),
        ("binary-cut-at-the-faces", sound[..body + 36].to_vec()),
        ("binary-cut-after-the-header", sound[..body].to_vec()),
        ("binary-claims-1e12-vertices", binary(head("1000000000000", "1"), &[3, 0, 1, 2])),
        ("binary-claims-1e12-vertices-in-100-bytes", chars.into()),
        ("binary-claims-1e12-faces", binary(head("3", "1000000000000"), &[3, 0, 1, 2])),
        ("binary-claims-2e63-vertices", binary(head("9223372036854775808", "1"), &[])),
        ("binary-one-face-too-many", binary(head("3", "2"), &[3, 0, 1, 2])),
        ("binary-nan", set(24, f32::NAN)),
        ("binary-infinite", set(8, f32::NEG_INFINITY)),
        ("binary-index-of-no-vertex", binary(head("3", "1"), &[3, 0, 1, 3])),
        ("binary-index-negative", binary(head("3", "1"), &[3, 0, 1, -1])),
        ("binary-list-negative", binary(head("3", "1"), &[-1, 0, 1, 2])),
        ("binary-list-of-2e31", binary(head("3", "1"), &[i32::MAX, 0, 1, 2])),
        ("binary-face-of-nothing", binary(head("3", "1"), &[0])),
        ("binary-two-lists-cut", binary(mixed, &[0])),
        ("binary-read-as-the-other-order", binary(header("binary_big_endian", "3", "1"), &[3, 0, 1, 2])),
        ("strip-index-of-no-vertex", strips(&[3, 0, 1, 5])),
        ("strip-index-of-minus-2", strips(&[3, 0, 1, -2])),
        ("strip-of-2e31", strips(&[i32::MAX, 0, 1, 2])),
        ("strip-too-short", strips(&[2, 0, 1])),
    ];
    cases.into_iter().map(|(name, bytes)| scene(&format!("ply/{name}"), "bad.ply", bytes)).collect()
}

fn wholes() -> Vec<Case> {
    let long =
        SQUARE_PLY.replace("element vertex", &format!("comment {}\nelement vertex", "x".repeat(2 << 20)));
    let many =
        SQUARE_PLY.replace("element face", &format!("{}element face", "property char p\n".repeat(30_000)));
    let elements =
        SQUARE_PLY.replace("element vertex 4", &format!("{}element dot 4", "element void 0\n".repeat(9_000)));
    let stray = SQUARE_PLY.replace("element vertex", &format!("{}element vertex", "stray\n".repeat(9_000)));
    let coloured = SQUARE_PLY.replace(
        "property float z\n",
        "property float z\nproperty float red\nproperty float green\nproperty float blue\n",
    );
    let rows = |bad: &str| {
        coloured.replace(" 0\n", " 0 0.5 0.5 0.5\n").replace("1 1 0 0.5 0.5 0.5", &format!("1 1 0 {bad}"))
    };
    let noise: Vec<u8> = (0..100_000u32).map(|k| (k.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
    let mut latin = SQUARE_PLY.replace("1 1 0", "1 1 Q").into_bytes();
    latin.iter_mut().filter(|byte| **byte == b'Q').for_each(|byte| *byte = 0xfc);
    let cases: Vec<(&str, Vec<u8>)> = vec![
        ("empty", Vec::new()),
        ("one-byte", b"p".to_vec()),
        ("magic-alone", b"ply".to_vec()),
        ("magic-line-alone", b"ply\n".to_vec()),
        ("header-alone", SQUARE_PLY.as_bytes()[..SQUARE_PLY.find("0 0 0").expect("a body")].to_vec()),
        ("header-without-line-end", b"ply\nformat ascii 1.0\nend_header".to_vec()),
        ("carriage-returns-only", SQUARE_PLY.replace('\n', "\r").into()),
        ("carriage-returns-only-and-cut", SQUARE_PLY.replace('\n', "\r").replace("4 0 1 2 3\r", "").into()),
        ("zeros", vec![0; 5000]),
        ("noise", noise),
        ("comment-of-2-mebibytes", long.into()),
        ("properties-30000", many.into()),
        ("elements-9000", elements.into()),
        ("stray-lines-9000", stray.into()),
        ("row-in-latin-1", latin),
        ("colour-of-nan", rows("nan 0.5 0.5").into()),
        ("colour-negative", rows("0.5 -0.5 0.5").into()),
        ("colour-of-1e9", rows("0.5 0.5 1e9").into()),
        ("colour-up-to-255", rows("0.5 0.5 200").into()),
        ("colour-white", rows("1 1 1").into()),
        ("an-stl", b"solid cube\nfacet normal 0 0 1\n".to_vec()),
        ("a-zip", b"PK\x03\x04\x14\x00\x00\x00\x08\x00".to_vec()),
    ];
    cases.into_iter().map(|(name, bytes)| scene(&format!("ply/{name}"), "bad.ply", bytes)).collect()
}

/// All of them.
pub fn cases() -> Vec<Case> {
    let mut cases: Vec<Case> = SQUARES
        .iter()
        .map(|(name, there, instead)| {
            assert!(SQUARE_PLY.contains(there), "{there:?} is in the square");
            let text = SQUARE_PLY
                .replacen(there, instead, 1)
                .replace("LONG", &format!("1 1 {}\n", "y".repeat(10_000)));
            scene(&format!("ply/{name}"), "bad.ply", text)
        })
        .collect();
    cases.extend(binaries());
    cases.extend(wholes());
    cases
}

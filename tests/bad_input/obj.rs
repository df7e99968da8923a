//! Broken OBJ meshes and material libraries.

use crate::{Case, scene};

/// Three vertices; most broken files are these and a line or two.
const CORNERS: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";

/// Lines after the three vertices.
const LINES: &[(&str, &str)] = &[
    ("no-face", ""),
    ("index-of-no-vertex", "f 1 2 4\n"),
    ("index-of-no-vertex-in-two-lines", "f 1 2 3\nf 1 2 9\nf 1 2 4\n"),
    ("index-0", "f 1 2 0\n"),
    ("index-before-the-first", "f -1 -2 -4\n"),
    ("index-fractional", "f 1 2 3.0\n"),
    ("index-a-word", "f a b c\n"),
    ("index-empty", "f / / /\n"),
    ("index-beyond-32-bits", "f 1 2 4294967297\n"),
    ("index-2e63-less-1", "f 1 2 9223372036854775807\n"),
    ("index-minus-2e63", "f 1 2 -9223372036854775808\n"),
    ("index-of-20-digits", "f 1 2 99999999999999999999\n"),
    ("index-of-10000-digits", "f 1 2 LONG\n"),
    ("texture-coordinate-missing", "f 1/1 2/1 3/1\n"),
    ("normal-missing", "f 1//1 2//1 3//1\n"),
    ("texture-coordinate-a-word", "vt 0 0\nf 1/x 2/1 3/1\n"),
    ("faces-too-short", "f 1 2\nf 1\nf\n"),
    ("face-without-area", "f 1 1 1\n"),
    ("vertex-of-two-numbers", "v 0 0\nf 1 2 3\n"),
    ("vertex-a-word", "v 0 0 zero\nf 1 2 3\n"),
    ("vertex-nan", "v 0 0 NaN\nf 1 2 3\n"),
    ("vertex-infinite", "v 0 0 -inf\nf 1 2 3\n"),
    ("vertex-beyond-double", "v 0 0 1e999\nf 1 2 3\n"),
    ("vertex-of-msvc-nan", "v 0 0 1.#IND\nf 1 2 3\n"),
    ("vertex-weight-a-word", "v 0 0 0 w\nf 1 2 3\n"),
    ("vertex-colour-nan", "v 0 0 0 nan 0 0\nf 1 2 3\n"),
    ("vertex-colours-of-some", "v 0 0 1 0.5 0.5 0.5\nf 1 2 4\n"),
    ("normal-of-two-numbers", "vn 0 0\nf 1 2 3\n"),
    ("normal-beyond-single", "vn 0 0 1e300\nf 1//1 2//1 3//1\n"),
    ("texture-coordinate-empty", "vt\nf 1 2 3\n"),
    ("texture-coordinate-infinite", "vt inf 0\nf 1 2 3\n"),
    ("escape-codes", "f 1 2 \u{1b}[2J\n"),
    ("keyword-unknown", "fa 1 2 3\nf 1 2 3\n"),
    ("backslash-at-the-end", "f 1 2 \\"),
    ("free-form-curves", "curv 0 1 1 2 3\n"),
    ("library-missing", "mtllib gone.mtl\nusemtl a\nf 1 2 3\n"),
    ("library-a-folder", "mtllib .\nusemtl a\nf 1 2 3\n"),
    ("library-endless", "mtllib /dev/zero\nusemtl a\nf 1 2 3\n"),
    ("library-without-name", "mtllib\nusemtl a\nf 1 2 3\n"),
    ("material-unknown", "mtllib m.mtl\nusemtl unknown\nf 1 2 3\n"),
    ("material-unknown-with-escape-codes", "mtllib m.mtl\nusemtl \u{1b}[31mred\nf 1 2 3\n"),
];

/// Material libraries whose material `a` the triangle takes.
const LIBRARIES: &[(&str, &str)] = &[
    ("albedo-of-2", "newmtl a\nKd 2 0 0\n"),
    ("albedo-negative", "newmtl a\nKd 0 -0.5 0\n"),
    ("albedo-nan", "newmtl a\nKd nan 0 0\n"),
    ("albedo-a-word", "newmtl a\nKd 0.5 zero 0.5\n"),
    ("albedo-of-one-number", "newmtl a\nKd 0.5\n"),
    ("albedo-white", "newmtl a\nKd 1 1 1\n"),
    ("emission-negative", "newmtl a\nKd 0.5 0.5 0.5\nKe 0 -1 0\n"),
    ("emission-infinite", "newmtl a\nKd 0.5 0.5 0.5\nKe 0 inf 0\n"),
    ("emission-of-1e38", "newmtl a\nKd 0.5 0.5 0.5\nKe 0 1e38 0\n"),
    ("glass", "newmtl a\nKd 0.5 0.5 0.5\nd 0.2\nillum 7\n"),
    ("texture-missing", "newmtl a\nmap_Kd gone.png\n"),
    ("texture-missing-with-options", "newmtl a\nmap_Kd -s 1 1 1 gone.png\n"),
    ("texture-no-picture", "newmtl a\nmap_Kd bad.obj\n"),
    ("texture-endless", "newmtl a\nmap_Kd /dev/zero\n"),
    ("texture-a-folder", "newmtl a\nmap_Kd .\n"),
    ("keyword-without-material", "Kd 0.5 0.5 0.5\n"),
    ("empty", ""),
    ("zeros", "\0\0\0\0\0\0"),
];

/// All of them.
pub fn cases() -> Vec<Case> {
    let library = "newmtl a\nKd 0.5 0.5 0.5\n";
    let lines = LINES.iter().map(|(name, lines)| {
        let text = format!("{CORNERS}{}", lines.replace("LONG", &"7".repeat(10_000)));
        scene(&format!("obj/{name}"), "bad.obj", text).with("m.mtl", library)
    });
    let libraries = LIBRARIES.iter().map(|(name, library)| {
        let text = format!("mtllib m.mtl\n{CORNERS}vt 0 0\nusemtl a\nf 1/1 2/1 3/1\n");
        scene(&format!("mtl/{name}"), "bad.obj", text).with("m.mtl", library)
    });
    let noise: Vec<u8> = (0..100_000u32).map(|k| (k.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
    let colours = "v 0 0 0 1 1 1\nv 1 0 0 1 1 1\nv 0 1 0 1 1 1\nf 1 2 3\n";
    let apart = "v 1e308 0 0\nv -1e308 0 0\nv 0 1 0\nf 1 2 3\n";
    let far_uv = format!("mtllib m.mtl\n{CORNERS}vt 1e300 0\nusemtl a\nf 1/1 2/1 3/1\n");
    let again = format!("{}{CORNERS}f 1 2 3\n", "mtllib m.mtl\nmtllib gone.mtl\n".repeat(5_000));
    let others = [
        scene("obj/empty", "bad.obj", ""),
        scene("obj/zeros", "bad.obj", vec![0; 5000]),
        scene("obj/noise", "bad.obj", noise),
        scene("obj/colours-white", "bad.obj", colours),
        scene("obj/vertices-1e308-apart", "bad.obj", apart),
        scene("obj/not-utf-8", "bad.obj", b"v 0 0 0\nv 1 0 \xff\n"),
        scene("obj/texture-coordinate-beyond-single", "bad.obj", far_uv)
            .with("m.mtl", "newmtl a\nmap_Kd grey.png\n")
            .with("grey.png", crate::scene_shared::pictures::png(2, 2)),
        scene("obj/library-named-10000-times", "bad.obj", again).with("m.mtl", library),
    ];
    lines.chain(libraries).chain(others).collect()
}

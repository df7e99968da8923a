//! Odd and broken inputs: each gets exactly the answer it should, promptly and within bounded memory.

mod scene_shared;

use std::path::Path;
use std::time::{Duration, Instant};

use glowtree::Error;
use glowtree::scene::{self, Scene};
use scene_shared::{Folder, SQUARE_PLY, shared, triangles_in_file};

/// The answer that a file deserves.
enum Answer {
    /// Loads with so many triangles (degenerate ones counted), with a warning that holds this text unless empty.
    Accept(usize, &'static str),
    /// Exit code 4; place and problem hold these texts.
    Reject(&'static [&'static str]),
}
use Answer::{Accept, Reject};

/// No single file may take longer, on a busy machine.
const PATIENCE: Duration = Duration::from_secs(10);

fn judge(name: &str, answer: &Answer, load: impl FnOnce() -> Result<Scene, Error>) {
    let start = Instant::now();
    let loaded = load();
    assert!(start.elapsed() < PATIENCE, "{name} took {:?}", start.elapsed());
    match (answer, loaded) {
        (Accept(count, warning), Ok(scene)) => {
            assert_eq!(triangles_in_file(&scene), *count, "{name}: {:?}", scene.warnings);
            assert!(scene.vertices.iter().all(|v| v.is_finite()), "{name} has vertices that are not finite");
            let heard = warning.is_empty() || scene.warnings.iter().any(|w| w.message.contains(warning));
            assert!(heard, "{name} should warn of {warning:?}, warned {:?}", scene.warnings);
        }
        (Reject(texts), Err(error)) => {
            assert_eq!(error.exit_code(), 4, "{name}: {error}");
            let Error::Input { place, problem, remedy, .. } = &error else { panic!("{name}: {error}") };
            assert!(!remedy.is_empty() && !place.is_empty() && !problem.is_empty(), "{name}: {error}");
            let said = format!("{place}: {problem}; {remedy}");
            assert!(said.len() < 600 && !said.contains('\n'), "{name}: one short line is wanted: {said}");
            for text in *texts {
                assert!(said.contains(text), "{name} should name {text:?}: {said}");
            }
        }
        (Accept(..), Err(error)) => panic!("{name} should load: {error}"),
        (Reject(_), Ok(scene)) => {
            panic!("{name} should be refused, gave {} triangles", scene.triangles.len())
        }
    }
}

const FILES: &[(&str, Answer)] = &[
    ("ply/assimp-empty.ply", Reject(&["line 1", "empty"])),
    ("ply/assimp-crash-30d6.ply", Reject(&["line 7", "end_header"])),
    ("ply/assimp-cube_binary.ply", Accept(12, "")),
    ("ply/assimp-cube_header_CRLF.ply", Accept(12, "")),
    ("ply/assimp-issue623.ply", Reject(&["no faces"])),
    ("ply/assimp-float-color.ply", Accept(1, "")),
    ("ply/assimp-pond.ply", Reject(&["no faces", "point cloud"])),
    ("ply/assimp-Wuson.ply", Accept(3732, "line 3")),
    ("ply/trimesh-empty_header.ply", Reject(&["no vertex element"])),
    ("ply/trimesh-metadata.ply", Accept(2, "")),
    ("ply/trimesh-points_ascii_with_lists.ply", Reject(&["no faces"])),
    ("ply/trimesh-fuze_ascii.ply", Accept(1000, "1000 lines hold more numbers")),
    ("ply/trimesh-fixed_top.ply", Accept(4772, "")),
    ("obj/trimesh-notenoughindices.obj", Accept(1, "first: line 9")),
    ("obj/trimesh-negative_indices.obj", Accept(12, "")),
    ("ply/draco-extra_whitespace.ply", Accept(1, "")),
    ("ply/draco-float_inf.ply", Reject(&["no faces"])),
    ("ply/draco-more_datatypes.ply", Accept(1, "")),
    ("obj/draco-deg_faces.obj", Accept(4, "1 triangles without area")),
    ("obj/draco-extra_vertex.obj", Accept(3, "")),
    ("ply/openmesh-extra_elements.ply", Accept(12, "")),
    ("ply/openmesh-custom_props.ply", Accept(12, "")),
    ("ply/openmesh-pointCloudBadEncoding.ply", Reject(&["no faces"])),
    ("ply/plyrs-single_elements_err.ply", Reject(&["truncated"])),
    ("ply/plyrs-all_atomic_types.ply", Reject(&["no vertex element"])),
    ("ply/plyrs-exponent_values.ply", Reject(&["no vertex element"])),
    ("ply/plyrs-house_2_le.ply", Accept(3, "")),
    ("ply/plyrsbw-tetrahedron_little_endian.ply", Accept(4, "")),
    ("ply/plyrsbw-doubles_shorts.ply", Accept(1, "")),
    ("ply/happly-platonic_shelf.ply", Accept(80, "")),
    ("ply/happly-platonic_shelf_ascii.ply", Accept(80, "")),
    ("obj/assimp-malformed.obj", Reject(&["line 28", "index 0"])),
    ("obj/assimp-box_longline.obj", Accept(12, "")),
    ("obj/assimp-concave_polygon.obj", Accept(64, "")),
    ("obj/tinyobj-invalid-face-definition.obj", Reject(&["line 15", "no valid face"])),
    ("obj/tinyobj-test-nan.obj", Reject(&["line 12", "not finite"])),
    ("gltf/IndexOutOfRange/IndexOutOfRange.gltf", Reject(&["mesh 0", "out of range"])),
    ("gltf/MissingBin/BoxTextured.gltf", Reject(&["buffer 0", "BoxTextured0.bin", "does not exist"])),
    ("gltf/wrongTypes/badNumber.gltf", Reject(&["line 132", "not a number"])),
    ("gltf/wrongTypes/badArray.gltf", Reject(&["line 44", "expected a sequence"])),
    ("exr/invalid_integer_bounds.exr", Reject(&["EXR", "cannot be read"])),
    ("exr/comp_bad_bounds_piz.exr", Reject(&["EXR", "cannot be read"])),
    ("exr/comp_early_eof_piz.exr", Reject(&["EXR", "cannot be read"])),
];

#[test]
fn the_collected_files_get_their_answers() {
    let Some(folder) = shared("data/bad-input") else { return };
    let desk = Folder::new();
    desk.write("square.ply", SQUARE_PLY);
    for (name, answer) in FILES {
        let path = folder.join(name);
        if path.extension().is_some_and(|e| e == "exr") {
            let scene =
                format!("[[mesh]]\nfile = \"square.ply\"\n[sky]\nfile = {:?}\n", path.to_string_lossy());
            judge(name, answer, || desk.load("scene.toml", scene));
        } else {
            judge(name, answer, || scene::load(&path));
        }
    }
    let mut found = Vec::new();
    list(&folder, &mut found);
    assert_eq!(found.len(), FILES.len(), "every file has a row in the table: {found:?}");
}

fn list(folder: &Path, found: &mut Vec<std::path::PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("the folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            list(&path, found);
        } else if path.extension().is_some_and(|e| e != "md" && e != "bin") {
            found.push(path);
        }
    }
}

/// ASCII PLYs made from the good square by one replacement.
const SQUARES: &[(&str, &str, Answer)] = &[
    ("ply\n", "PLY\n", Reject(&["line 1", "expected `ply`"])),
    ("format ascii 1.0", "format ascci 1.0", Reject(&["line 2", "ascci"])),
    ("format ascii 1.0\n", "", Reject(&["no `format` line"])),
    ("format ascii 1.0", "format", Reject(&["line 2"])),
    ("element vertex 4", "element vertex", Reject(&["line 3", "NAME COUNT"])),
    ("element vertex 4", "element vertex -4", Reject(&["line 3", "\"-4\""])),
    ("element vertex 4", "element vertex 4.5", Reject(&["line 3", "\"4.5\""])),
    ("element vertex 4", "element vertex 1000000000000", Reject(&["element vertex", "truncated"])),
    ("element vertex 4", "element vertex 18446744073709551615", Reject(&["element vertex", "truncated"])),
    ("element vertex 4", "element vertex 18446744073709551616", Reject(&["line 3", "count"])),
    ("element vertex 4", "element vertex 99999999999999999999999999", Reject(&["line 3", "count"])),
    ("element vertex 4", "element points 4", Reject(&["no vertex element"])),
    ("element vertex 4", "elemental vertex 4", Reject(&["before any element"])),
    ("element vertex 4", "element vertex 3", Reject(&["no triangle"])),
    ("element vertex 4", "element vertex 5", Reject(&["truncated"])),
    (
        "element vertex 4\n",
        "element void 4000000000\nelement vertex 4\n",
        Reject(&["element void", "without any property"]),
    ),
    ("element vertex 4\n", "element void 0\nelement vertex 4\n", Accept(2, "")),
    ("element vertex 4\n", "a stray line\nelement vertex 4\n", Accept(2, "header line 3")),
    ("element vertex 4\n", "element vertex 4\na stray line\n", Reject(&["line 4", "none of comment"])),
    ("property float x", "property real x", Reject(&["line 4", "\"real\" is no PLY type"])),
    ("property float x", "property float", Reject(&["line 4", "expected `property"])),
    ("property float x", "property float q", Reject(&["no numbers called x, y and z"])),
    ("property float x", "property list float int x", Reject(&["line 4", "no integer"])),
    ("property float x", "propety float x", Reject(&["line 4", "propety"])),
    ("format ascii 1.0\n", "format ascii 1.0\nproperty float x\n", Reject(&["line 3", "before any element"])),
    ("element face 1", "element face 0", Reject(&["no faces"])),
    ("element face 1", "element face 2", Reject(&["face row 1", "truncated"])),
    ("element face 1", "element face 4000000000", Reject(&["element face", "truncated"])),
    ("element face 1", "element polygon 1", Reject(&["no faces"])),
    ("list uchar int vertex_indices", "list uchar float vertex_indices", Reject(&["no list of integers"])),
    ("list uchar int vertex_indices", "list uchar int corners", Reject(&["no list of integers"])),
    ("list uchar int vertex_indices", "int vertex_indices", Reject(&["no list of integers"])),
    ("end_header\n", "", Reject(&["end_header"])),
    ("end_header\n", "end_headerr\n", Reject(&["end_headerr"])),
    ("1 1 0\n", "1 nan 0\n", Reject(&["line 12, vertex row 2", "not finite"])),
    ("1 1 0\n", "1 inf 0\n", Reject(&["line 12", "not finite"])),
    ("1 1 0\n", "1 -1e999 0\n", Reject(&["line 12", "not finite"])),
    ("1 1 0\n", "1 one 0\n", Reject(&["line 12", "\"one\" is no number"])),
    ("1 1 0\n", "1 1\n", Reject(&["line 12", "fewer numbers"])),
    ("1 1 0\n", "1 1 0 7\n", Accept(2, "first: line 12")),
    ("1 1 0\n", "1 1 \u{fc}\n", Reject(&["line 12"])),
    ("4 0 1 2 3", "4 0 1 2 4", Reject(&["face row 0", "index 4 is out of range, there are 4"])),
    ("4 0 1 2 3", "4 0 1 2 -1", Reject(&["index -1 is out of range"])),
    ("4 0 1 2 3", "4 0 1 2 4294967296", Reject(&["face row 0"])),
    ("4 0 1 2 3", "4 0 1 2 1.5", Reject(&["1.5 stands where an integer"])),
    ("4 0 1 2 3", "-4 0 1 2 3", Reject(&["a list of -4"])),
    ("4 0 1 2 3", "4000000000 0 1 2 3", Reject(&["a list of 4000000000"])),
    ("4 0 1 2 3", "1e300 0 1 2 3", Reject(&["a list of 1"])),
    ("4 0 1 2 3", "5 0 1 2 3", Reject(&["fewer numbers"])),
    ("4 0 1 2 3", "3 0 1 2 3", Accept(1, "more numbers")),
    ("4 0 1 2 3", "4 0 1 2 3\n3 0 1 2", Accept(2, "after the last row")),
    ("4 0 1 2 3", "4 0 1 1 3", Accept(1, "")),
    ("4 0 1 2 3", "2 0 1", Reject(&["no triangle"])),
    ("4 0 1 2 3", "3 0 0 0", Reject(&["one point"])),
    ("4 0 1 2 3", "3 0 1 1", Reject(&["area"])),
    ("4 0 1 2 3", "4 0 2 1 3", Accept(2, "cross themselves")),
    ("4 0 1 2 3", "", Reject(&["truncated"])),
    ("1 0 0\n1 1 0\n0 1 0\n", "0 0 0\n0 0 0\n0 0 0\n", Reject(&["one point"])),
    ("1 0 0\n1 1 0\n0 1 0\n", "1 1 1\n2 2 2\n3 3 3\n", Reject(&["area"])),
    ("1 0 0\n1 1 0\n0 1 0\n", "1e308 0 0\n-1e308 1 0\n0 1 0\n", Reject(&["extent"])),
];

#[test]
fn broken_squares_get_their_answers() {
    let folder = Folder::new();
    judge("the square", &Accept(2, ""), || folder.load("good.ply", SQUARE_PLY));
    for (good, bad, answer) in SQUARES {
        assert!(SQUARE_PLY.contains(good), "{good:?} is in the square");
        let text = SQUARE_PLY.replacen(good, bad, 1);
        judge(&format!("{good:?} -> {bad:?}"), answer, || folder.load("bad.ply", text));
    }
}

#[test]
fn hostile_binary_headers_are_refused_at_once() {
    let head = |vertices: &str, faces: &str| {
        format!(
            "ply\nformat binary_little_endian 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\n\
             property float z\nelement face {faces}\nproperty list int int vertex_indices\nend_header\n"
        )
        .into_bytes()
    };
    let with = |mut bytes: Vec<u8>, list: &[i32]| {
        [0f32, 0., 0., 1., 0., 0., 0., 1., 0.].iter().for_each(|f| bytes.extend(f.to_le_bytes()));
        list.iter().for_each(|i| bytes.extend(i.to_le_bytes()));
        bytes
    };
    let nan = {
        let mut bytes = with(head("3", "1"), &[3, 0, 1, 2]);
        let at = bytes.len() - 16 - 4;
        bytes[at..at + 4].copy_from_slice(&f32::NAN.to_le_bytes());
        bytes
    };
    let strips = |list: &[i32]| {
        let text = String::from_utf8(head("3", "1")).unwrap().replace("element face", "element tristrips");
        with(text.into_bytes(), list)
    };
    let void = b"ply\nformat binary_little_endian 1.0\nelement a 4000000000\nelement vertex 1\nproperty float x\nend_header\n";
    let cases: Vec<(&str, Vec<u8>, Answer)> = vec![
        ("sound", with(head("3", "1"), &[3, 0, 1, 2]), Accept(1, "")),
        ("sound strips", strips(&[7, 0, 1, 2, -1, 2, 1, 0]), Accept(2, "")),
        (
            "1e12 vertices",
            with(head("1000000000000", "1"), &[3, 0, 1, 2]),
            Reject(&["element vertex", "truncated"]),
        ),
        (
            "1e12 faces",
            with(head("3", "1000000000000"), &[3, 0, 1, 2]),
            Reject(&["element face", "truncated"]),
        ),
        (
            "2^63 vertices",
            with(head("9223372036854775808", "1"), &[]),
            Reject(&["element vertex", "truncated"]),
        ),
        ("no body", head("3", "1"), Reject(&["element vertex", "truncated"])),
        ("short list", with(head("3", "1"), &[3, 0, 1]), Reject(&["face row 0", "truncated"])),
        ("short rows", with(head("3", "2"), &[3, 0, 1, 2]), Reject(&["face row 1", "truncated"])),
        ("length -1", with(head("3", "1"), &[-1, 0, 1, 2]), Reject(&["face row 0", "a list of -1"])),
        ("length 2^31-1", with(head("3", "1"), &[i32::MAX, 0, 1, 2]), Reject(&["face row 0", "truncated"])),
        ("index 3 of 3", with(head("3", "1"), &[3, 0, 1, 3]), Reject(&["face row 0", "out of range"])),
        ("index -1", with(head("3", "1"), &[3, 0, 1, -1]), Reject(&["face row 0", "out of range"])),
        ("NaN", nan, Reject(&["vertex row 2", "not finite"])),
        ("zero-property element", void.to_vec(), Reject(&["element a", "without any property"])),
        ("strip index", strips(&[3, 0, 1, 5]), Reject(&["tristrips row 0", "out of range"])),
        ("strip index -2", strips(&[3, 0, 1, -2]), Reject(&["tristrips row 0", "out of range"])),
        ("strip length", strips(&[i32::MAX, 0, 1, 2]), Reject(&["tristrips row 0", "truncated"])),
        ("strip length -1", strips(&[-1, 0, 1, 2]), Reject(&["tristrips row 0"])),
    ];
    let folder = Folder::new();
    let start = Instant::now();
    for (name, bytes, answer) in &cases {
        judge(name, answer, || folder.load("hostile.ply", bytes));
    }
    assert!(start.elapsed() < Duration::from_secs(5), "all of them in {:?}", start.elapsed());
}

#[test]
fn long_headers_and_lines_are_bounded() {
    let folder = Folder::new();
    let comment =
        SQUARE_PLY.replace("element vertex", &format!("comment {}\nelement vertex", "x".repeat(2 << 20)));
    judge("2 MiB comment", &Reject(&["end_header"]), || folder.load("long.ply", comment));
    let many =
        SQUARE_PLY.replace("element face", &format!("{}element face", "property char p\n".repeat(30_000)));
    judge("30 000 properties", &Reject(&["element vertex", "truncated"]), || folder.load("many.ply", many));
    let noise: Vec<u8> = (0..100_000u32).map(|k| (k.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
    for name in ["noise.ply", "noise.obj", "noise.gltf", "noise.glb", "noise.toml"] {
        judge(name, &Reject(&[]), || folder.load(name, &noise));
    }
    let mut polygon =
        String::from("ply\nformat ascii 1.0\nelement vertex 20000\nproperty float x\nproperty float y\n");
    polygon += "property float z\nelement face 1\nproperty list int int vertex_indices\nend_header\n";
    for k in 0..20_000 {
        let (radius, angle) = (1.0 + f64::from(k % 2), f64::from(k) * std::f64::consts::TAU / 20_000.0);
        polygon += &format!("{} {} 0\n", radius * angle.cos(), radius * angle.sin());
    }
    polygon += "20000";
    (0..20_000).for_each(|k| polygon += &format!(" {k}"));
    judge("a saw of 20 000 corners", &Accept(19_998, ""), || folder.load("saw.ply", polygon));
}

/// Every truncation and a walk of byte changes over good files: any answer will do, but no panic and no delay.
#[test]
fn cut_and_changed_files_never_panic() {
    let folder = Folder::new();
    let mut seeds: Vec<(String, Vec<u8>)> = vec![("square.ply".into(), SQUARE_PLY.into())];
    seeds.push(("toml.toml".into(), GOOD_TOML.into()));
    seeds.push((
        "o.obj".into(),
        b"mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\nusemtl a\nf 1/1/1 2/1/1 -1//1\n"
            .to_vec(),
    ));
    seeds.push(("g.glb".into(), scene_shared::small_glb()));
    if let Some(data) = shared("data/bad-input") {
        for name in
            ["ply/plyrs-house_2_le.ply", "ply/assimp-cube_binary.ply", "gltf/wrongTypes/badNumber.gltf"]
        {
            let path = data.join(name);
            seeds.push((
                path.file_name().unwrap().to_string_lossy().into_owned(),
                std::fs::read(path).unwrap(),
            ));
        }
    }
    folder.write("square2.ply", SQUARE_PLY);
    folder.write("m.mtl", "newmtl a\nKd 1 1 1\n");
    let start = Instant::now();
    let mut loads = 0;
    for (name, bytes) in &seeds {
        let step = 1 + bytes.len() / 100;
        for cut in (0..bytes.len()).step_by(step) {
            let _ = folder.load(name, &bytes[..cut]);
            for value in [0u8, 0xff, b'9', b'-', bytes[cut] ^ 0x80] {
                let mut changed = bytes.clone();
                changed[cut] = value;
                let _ = folder.load(name, &changed);
                loads += 1;
            }
        }
    }
    println!("{loads} changed files in {:?}", start.elapsed());
    assert!(start.elapsed() < Duration::from_secs(100), "{loads} files took {:?}", start.elapsed());
}

const GOOD_TOML: &str = "[[mesh]]\nfile = \"square2.ply\"\nalbedo = [0.5, 0.5, 0.5]\nradiance = [0, 0, 0]\nsides = 1\n\
name = \"wall\"\ntransform = { scale = 1.0, rotate = [0, 1, 0, 30], translate = [0, 0, 0] }\n[sky]\nradiance = [1, 1, 1]\n\
up = \"y\"\n[[lamp]]\nkind = \"sun\"\ndirection = [0.3, -1.0, 0.2]\nirradiance = [3, 2.8, 2.5]\nname = \"sun\"\n\
[[camera]]\nname = \"front\"\neye = [2.78, 2.73, -8.0]\ntarget = [2.78, 2.73, 0.0]\nup = [0, 1, 0]\nfov = 39.3\n\
size = [512, 512]\n";

/// Scene files made from the good one by one replacement.
const SCENES: &[(&str, &str, Answer)] = &[
    (
        "file = \"square2.ply\"",
        "file = \"nowhere.ply\"",
        Reject(&["line 2", "mesh.file", "nowhere.ply does not exist"]),
    ),
    ("file = \"square2.ply\"", "fiel = \"square2.ply\"", Reject(&["line 2", "`fiel`", "`file`"])),
    ("file = \"square2.ply\"\n", "", Reject(&["file"])),
    ("file = \"square2.ply\"", "file = 7", Reject(&["line 2", "string"])),
    ("file = \"square2.ply\"", "file = \"scene.toml\"", Reject(&["toml"])),
    ("[[mesh]]", "[[mash]]", Reject(&["line 1", "`mash`", "`mesh`"])),
    ("[[mesh]]", "[mesh]", Reject(&["sequence"])),
    ("[[mesh]]", "[[mesh]", Reject(&["line 1"])),
    ("albedo = [0.5, 0.5, 0.5]", "albdo = [0.5, 0.5, 0.5]", Reject(&["line 3", "`albdo`", "`albedo`"])),
    ("albedo = [0.5, 0.5, 0.5]", "colour = [0.5, 0.5, 0.5]", Reject(&["line 3", "`colour`"])),
    (
        "albedo = [0.5, 0.5, 0.5]",
        "albedo = [0.5, 1, 0.5]",
        Reject(&["line 3", "mesh.albedo", "outside [0, 1)"]),
    ),
    ("albedo = [0.5, 0.5, 0.5]", "albedo = [0.5, 1.5, 0.5]", Reject(&["mesh.albedo", "outside [0, 1)"])),
    (
        "albedo = [0.5, 0.5, 0.5]",
        "albedo = [0.5, 0.99999999, 0.5]",
        Reject(&["mesh.albedo", "outside [0, 1)"]),
    ),
    ("albedo = [0.5, 0.5, 0.5]", "albedo = [0.5, -0.1, 0.5]", Reject(&["mesh.albedo", "outside [0, 1)"])),
    ("albedo = [0.5, 0.5, 0.5]", "albedo = [0.5, nan, 0.5]", Reject(&["mesh.albedo", "not finite"])),
    ("albedo = [0.5, 0.5, 0.5]", "albedo = [0.5, inf, 0.5]", Reject(&["mesh.albedo", "not finite"])),
    (
        "albedo = [0.5, 0.5, 0.5]",
        "albedo = [0.5, 0.5]",
        Reject(&["mesh.albedo", "3 numbers are expected, found 2"]),
    ),
    ("albedo = [0.5, 0.5, 0.5]", "albedo = [0.5, \"0.5\", 0.5]", Reject(&["mesh.albedo", "number"])),
    (
        "albedo = [0.5, 0.5, 0.5]",
        "albedo = \"vertices\"",
        Reject(&["mesh.albedo", "\"vertices\" is no albedo", "vertex"]),
    ),
    ("albedo = [0.5, 0.5, 0.5]", "albedo = \"vertex\"", Reject(&["mesh.albedo", "no vertex colours"])),
    ("albedo = [0.5, 0.5, 0.5]", "albedo = 1.0", Reject(&["outside [0, 1)"])),
    ("albedo = [0.5, 0.5, 0.5]", "albedo = 0.25", Accept(2, "")),
    ("albedo = [0.5, 0.5, 0.5]", "albedo = true", Reject(&["mesh.albedo", "3 numbers"])),
    (
        "albedo = [0.5, 0.5, 0.5]",
        "albedo = { texture = \"x.png\" }",
        Reject(&["mesh.albedo.texture", "x.png does not exist"]),
    ),
    ("albedo = [0.5, 0.5, 0.5]", "albedo = { image = \"x.png\" }", Reject(&["`image`", "`texture`"])),
    ("albedo = [0.5, 0.5, 0.5]", "albedo = { texture = \"square2.ply\" }", Reject(&["picture"])),
    ("albedo = [0.5, 0.5, 0.5]\n", "", Accept(2, "")),
    ("radiance = [0, 0, 0]", "radiance = [0, -1, 0]", Reject(&["line 4", "mesh.radiance", "negative"])),
    ("radiance = [0, 0, 0]", "radiance = [0, inf, 0]", Reject(&["mesh.radiance", "not finite"])),
    ("radiance = [0, 0, 0]", "radiance = [0, 1e39, 0]", Reject(&["mesh.radiance", "not finite"])),
    ("radiance = [0, 0, 0]", "radiance = [0, nan, 0]", Reject(&["mesh.radiance", "not finite"])),
    ("radiance = [0, 0, 0]", "radiance = \"bright\"", Reject(&["mesh.radiance"])),
    ("sides = 1", "sides = 3", Reject(&["line 5", "mesh.sides", "3 sides"])),
    ("sides = 1", "sides = 0", Reject(&["mesh.sides"])),
    ("sides = 1", "sides = 1.5", Reject(&["line 5"])),
    ("sides = 1", "side = 1", Reject(&["`side`", "`sides`"])),
    ("sides = 1", "sides = 1\nsides = 2", Reject(&["line 6", "duplicate"])),
    ("scale = 1.0", "scale = 0", Reject(&["line 7", "transform.scale"])),
    ("scale = 1.0", "scale = nan", Reject(&["transform.scale", "not finite"])),
    ("scale = 1.0", "scale = [1, 2]", Reject(&["transform.scale", "3 numbers"])),
    ("scale = 1.0", "scale = [1, 2, -3]", Accept(2, "")),
    ("scale = 1.0", "sclae = 1.0", Reject(&["`sclae`", "`scale`"])),
    ("rotate = [0, 1, 0, 30]", "rotate = [0, 0, 0, 30]", Reject(&["transform.rotate", "axis"])),
    ("rotate = [0, 1, 0, 30]", "rotate = [0, 1, 0]", Reject(&["transform.rotate", "4 numbers"])),
    ("translate = [0, 0, 0]", "translate = [0, 0, 1e400]", Reject(&["line 7"])),
    ("radiance = [1, 1, 1]\n", "", Reject(&["sky", "neither"])),
    ("radiance = [1, 1, 1]", "radiance = [1, -1, 1]", Reject(&["line 9", "sky.radiance", "negative"])),
    ("radiance = [1, 1, 1]", "file = \"none.exr\"", Reject(&["sky.file", "none.exr does not exist"])),
    ("radiance = [1, 1, 1]", "file = \"square2.ply\"", Reject(&["\"ply\"", ".exr"])),
    ("radiance = [1, 1, 1]", "radiance = 1\nfile = \"square2.ply\"", Reject(&["sky.radiance", "both"])),
    ("radiance = [1, 1, 1]", "radiance = 1\nrotate = 30", Reject(&["sky.rotate"])),
    ("up = \"y\"", "up = \"w\"", Reject(&["sky.up", "\"w\" is no axis"])),
    ("[sky]", "[skye]", Reject(&["`skye`", "`sky`"])),
    ("kind = \"sun\"", "kind = \"moon\"", Reject(&["lamp.kind", "\"moon\"", "sun"])),
    ("kind = \"sun\"", "kind = \"point\"", Reject(&["lamp."])),
    ("kind = \"sun\"\n", "", Reject(&["kind"])),
    ("direction = [0.3, -1.0, 0.2]", "direction = [0, 0, 0]", Reject(&["lamp.direction", "no length"])),
    ("direction = [0.3, -1.0, 0.2]\n", "", Reject(&["lamp.direction", "a sun needs direction"])),
    (
        "direction = [0.3, -1.0, 0.2]",
        "direction = [0.3, -1.0, 0.2]\nposition = [0, 0, 0]",
        Reject(&["a sun has no position"]),
    ),
    ("irradiance = [3, 2.8, 2.5]", "irradiance = [-3, 2.8, 2.5]", Reject(&["lamp.irradiance", "negative"])),
    ("irradiance = [3, 2.8, 2.5]", "intensity = [3, 2.8, 2.5]", Reject(&["lamp."])),
    ("irradiance = [3, 2.8, 2.5]", "iradiance = [3, 2.8, 2.5]", Reject(&["`iradiance`", "`irradiance`"])),
    ("target = [2.78, 2.73, 0.0]", "target = [2.78, 2.73, -8.0]", Reject(&["camera.target", "same point"])),
    ("target = [2.78, 2.73, 0.0]\n", "", Reject(&["target"])),
    ("fov = 39.3", "fov = 180", Reject(&["camera.fov", "out of range"])),
    ("fov = 39.3", "fov = 0", Reject(&["camera.fov", "out of range"])),
    ("size = [512, 512]", "size = [512, 0]", Reject(&["camera.size", "512 x 0"])),
    ("size = [512, 512]", "size = [512, -1]", Reject(&["line 22"])),
    ("size = [512, 512]", "size = [70000, 70000]", Reject(&["camera.size"])),
    ("size = [512, 512]", "size = [512]", Reject(&["line 22"])),
    ("name = \"wall\"", "name = \"wall", Reject(&["line 6"])),
];

#[test]
fn broken_scene_files_get_their_answers() {
    let folder = Folder::new();
    folder.write("square2.ply", SQUARE_PLY);
    judge("the scene", &Accept(2, ""), || folder.load("good.toml", GOOD_TOML));
    for (good, bad, answer) in SCENES {
        assert!(GOOD_TOML.contains(good), "{good:?} is in the scene");
        let text = GOOD_TOML.replacen(good, bad, 1);
        judge(&format!("{good:?} -> {bad:?}"), answer, || folder.load("bad.toml", text));
    }
    judge("empty", &Reject(&["no mesh"]), || folder.load("empty.toml", ""));
    judge("not UTF-8", &Reject(&["UTF-8"]), || folder.load("latin.toml", b"# caf\xe9\n"));
    let twice = format!("{GOOD_TOML}[[mesh]]\nfile = \"square2.ply\"\nname = \"wall\"\n");
    judge("twice", &Reject(&["mesh.name", "taken"]), || folder.load("twice.toml", twice));
    let lamp = format!(
        "{GOOD_TOML}[[lamp]]\nkind = \"point\"\nposition = [0, 0, 0]\nintensity = 1\nname = \"wall\"\n"
    );
    judge("lamp named as a mesh", &Reject(&["lamp.name", "taken"]), || folder.load("lamp.toml", lamp));
    let far =
        SQUARE_PLY.replace("element vertex 4", "element vertex 5").replace("4 0 1", "1e300 -1e300 0\n4 0 1");
    judge("a stray vertex", &Accept(2, ""), || folder.load("far.ply", far));
    judge("dark", &Accept(2, "nothing gives light"), || {
        folder.load("dark.toml", "[[mesh]]\nfile = \"square2.ply\"\n")
    });
}

/// OBJ texts.
const OBJS: &[(&str, Answer)] = &[
    ("", Reject(&["no faces"])),
    ("v 0 0 0\nv 1 0 0\nv 0 1 0\n", Reject(&["no faces"])),
    ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", Accept(1, "")),
    ("f 1 2 3\nv 0 0 0\nv 1 0 0\nv 0 1 0\n", Accept(1, "")),
    ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 \\\n3\n", Accept(1, "")),
    ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3", Accept(1, "")),
    ("v 0 0 0\r\nv 1 0 0\r\nv 0 1 0\r\nf 1 2 3\r\n", Accept(1, "")),
    ("v 0 0 0 1\nv 1 0 0 1\nv 0 1 0 1\nf 1 2 3\n", Accept(1, "")),
    (
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n",
        Reject(&["line 4", "vertex index 4 is out of range, there are 3"]),
    ),
    ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2 9\nf 1 2 4\n", Reject(&["line 5", "index 9"])),
    ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 0\n", Reject(&["line 4", "index 0"])),
    ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf -1 -2 -4\n", Reject(&["line 4", "index -4"])),
    ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3.0\n", Reject(&["line 4", "\"3.0\""])),
    ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 99999999999999999999\n", Reject(&["line 4"])),
    ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 -9223372036854775808\n", Reject(&["line 4"])),
    ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9223372036854775807\n", Reject(&["line 4"])),
    ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/1 2/1 3/1\n", Reject(&["line 4", "texture coordinate index 1"])),
    ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1//1 2//1 3//1\n", Reject(&["line 4", "normal index 1"])),
    ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf / / /\n", Reject(&["line 4", "\"\" is no vertex index"])),
    ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf a b c\n", Reject(&["line 4", "\"a\""])),
    ("v 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", Reject(&["line 1", "three numbers"])),
    ("v 0 0 zero\n", Reject(&["line 1", "\"zero\" is no number"])),
    ("v 0 0 NaN\n", Reject(&["line 1", "not finite"])),
    ("v 0 0 -inf\n", Reject(&["line 1", "not finite"])),
    ("v 0 0 1.#IND\n", Reject(&["line 1", "no number"])),
    ("vn 0 0\n", Reject(&["line 1", "three numbers"])),
    ("vt\n", Reject(&["line 1", "without numbers"])),
    (
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2\nf 1\nf\nf 1 2 3\n",
        Accept(1, "3 faces with fewer than 3 corners skipped (first: line 4)"),
    ),
    (
        "v 0 0 0\nv 1 0 0\nv 0 1 0\ncurv 1\nf 1 2 3\n",
        Accept(1, "1 lines of kinds that are not read (first: line 4)"),
    ),
    ("v 0 0 0\nv 1 0 0\nv 0 1 0\nmtllib gone.mtl\nusemtl a\nf 1 2 3\n", Accept(1, "gone.mtl")),
    ("mtllib bad.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n", Accept(1, "cannot be read")),
    ("mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl unknown\nf 1 2 3\n", Accept(1, "in no library")),
    (
        "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl bright\nf 1 2 3\n",
        Reject(&["bright", "Kd", "outside [0, 1)"]),
    ),
    ("mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl dark\nf 1 2 3\n", Reject(&["dark", "Ke", "negative"])),
    ("mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl white\nf 1 2 3\n", Accept(1, "darkened")),
    (
        "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl glass\nf 1 2 3\n",
        Accept(1, "treated as diffuse: glass"),
    ),
    ("mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl pictured\nf 1 2 3\n", Accept(1, "texture left out")),
    ("v 0 0 0\nv 0 0 0\nv 0 0 0\nf 1 2 3\n", Reject(&["one point"])),
    ("v 0 0 0\nv 1 1 1\nv 2 2 2\nf 1 2 3\n", Reject(&["area"])),
];

#[test]
fn broken_objs_get_their_answers() {
    let folder = Folder::new();
    folder.write("bad.mtl", "newmtl a\nKd 0.5 zero 0.5\n");
    folder.write(
        "m.mtl",
        "newmtl bright\nKd 2 0 0\nnewmtl dark\nKe 0 -1 0\nnewmtl white\nKd 1 1 1\nnewmtl glass\nKd .5 .5 .5\nillum 7\n\
         newmtl pictured\nmap_Kd -s 1 1 1 gone.png\n",
    );
    for (text, answer) in OBJS {
        judge(&format!("{text:?}"), answer, || folder.load("bad.obj", text));
    }
}

#[test]
fn names_that_are_no_scene_are_refused() {
    let folder = Folder::new();
    judge("missing", &Reject(&["does not exist"]), || scene::load(Path::new("no/such/scan.ply")));
    judge("missing scene", &Reject(&["does not exist"]), || scene::load(Path::new("no/such/scene.toml")));
    judge("stl", &Reject(&["\"stl\"", ".ply"]), || folder.load("a.stl", "solid"));
    judge("no extension", &Reject(&[".ply"]), || folder.load("mesh", SQUARE_PLY));
    judge("folder", &Reject(&["folder"]), || scene::load(Path::new(".")));
    judge("upper case", &Accept(2, ""), || folder.load("A.PLY", SQUARE_PLY));
}

/// After all of the above in this process, memory must not have gone anywhere near what the files claimed.
#[test]
fn memory_stays_bounded() {
    let folder = Folder::new();
    for claim in ["1000000000000", "100000000", "4000000000"] {
        for name in ["vertex", "face"] {
            let good = if name == "vertex" { "element vertex 4" } else { "element face 1" };
            let text = SQUARE_PLY.replace(good, &format!("element {name} {claim}"));
            judge(claim, &Reject(&["truncated"]), || folder.load("claim.ply", text));
        }
    }
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:")?.split_whitespace().next()?.parse::<u64>().ok());
    println!("peak resident {peak:?} kB");
    assert!(peak.is_none_or(|kilobytes| kilobytes < 400_000), "{peak:?} kB at the peak");
}

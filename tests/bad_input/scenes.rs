//! Broken scene files.

use crate::{Ask, Case, scene, scene_shared::SQUARE_PLY};

/// A sound scene file.
const GOOD: &str = "[[mesh]]\nfile = \"square.ply\"\nalbedo = [0.5, 0.5, 0.5]\nradiance = [0, 0, 0]\nsides = 1\n\
name = \"wall\"\ntransform = { scale = 1.0, rotate = [0, 1, 0, 30], translate = [0, 0, 0] }\n[sky]\nradiance = [1, 1, 1]\n\
up = \"y\"\n[[lamp]]\nkind = \"sun\"\ndirection = [0.3, -1.0, 0.2]\nirradiance = [3, 2.8, 2.5]\nname = \"sun\"\n\
[[lamp]]\nkind = \"spot\"\nposition = [1, 2, 3]\ndirection = [0, -1, 0]\nintensity = 4\nangle = 30\nblend = 0.2\n\
[[camera]]\nname = \"front\"\neye = [2.78, 2.73, -8.0]\ntarget = [2.78, 2.73, 0.0]\nup = [0, 1, 0]\nfov = 39.3\n\
size = [512, 512]\n";

/// One change each: name, what is there, what stands there instead.
const CHANGES: &[(&str, &str, &str)] = &[
    ("table-misspelt", "[[mesh]]", "[[mash]]"),
    ("table-not-a-list", "[[mesh]]", "[mesh]"),
    ("table-unclosed", "[[mesh]]", "[[mesh]"),
    ("table-twice", "[sky]", "[sky]\nradiance = 1\n[sky]"),
    ("mesh-file-missing", "\"square.ply\"", "\"gone.ply\""),
    ("mesh-file-in-a-missing-folder", "\"square.ply\"", "\"no/where/square.ply\""),
    ("mesh-file-a-folder", "\"square.ply\"", "\".\""),
    ("mesh-file-empty", "\"square.ply\"", "\"\""),
    ("mesh-file-a-device", "\"square.ply\"", "\"/dev/zero\""),
    ("mesh-file-the-scene-itself", "\"square.ply\"", "\"scene.toml\""),
    ("mesh-file-of-unknown-kind", "\"square.ply\"", "\"square.stl\""),
    ("mesh-file-broken", "\"square.ply\"", "\"broken.ply\""),
    ("mesh-file-with-line-end", "\"square.ply\"", "\"a\\nb.ply\""),
    ("mesh-file-with-escape-codes", "\"square.ply\"", "\"\\u001b[31m.ply\""),
    ("mesh-file-with-zero-byte", "\"square.ply\"", "\"a\\u0000b.ply\""),
    ("mesh-file-of-10000-letters", "\"square.ply\"", "\"LONG.ply\""),
    ("mesh-file-a-number", "\"square.ply\"", "7"),
    ("mesh-file-not-given", "file = \"square.ply\"\n", ""),
    ("mesh-key-misspelt", "file = \"square.ply\"", "fiel = \"square.ply\""),
    ("mesh-key-unknown", "albedo =", "colour ="),
    ("mesh-key-of-10000-letters", "albedo =", "LONG ="),
    ("mesh-key-with-escape-codes", "albedo =", "\"\\u001b[31m\" ="),
    ("mesh-key-twice", "sides = 1", "sides = 1\nsides = 2"),
    ("mesh-string-unclosed", "\"wall\"", "\"wall"),
    ("albedo-of-1", "[0.5, 0.5, 0.5]", "[0.5, 1, 0.5]"),
    ("albedo-of-1.5", "[0.5, 0.5, 0.5]", "1.5"),
    ("albedo-rounding-to-1", "[0.5, 0.5, 0.5]", "0.99999999"),
    ("albedo-negative", "[0.5, 0.5, 0.5]", "[0.5, -0.1, 0.5]"),
    ("albedo-nan", "[0.5, 0.5, 0.5]", "[0.5, nan, 0.5]"),
    ("albedo-infinite", "[0.5, 0.5, 0.5]", "inf"),
    ("albedo-of-two-numbers", "[0.5, 0.5, 0.5]", "[0.5, 0.5]"),
    ("albedo-of-a-string-among-numbers", "[0.5, 0.5, 0.5]", "[0.5, \"0.5\", 0.5]"),
    ("albedo-of-nothing", "[0.5, 0.5, 0.5]", ""),
    ("albedo-true", "[0.5, 0.5, 0.5]", "true"),
    ("albedo-a-date", "[0.5, 0.5, 0.5]", "1979-05-27"),
    ("albedo-a-word", "[0.5, 0.5, 0.5]", "\"white\""),
    ("albedo-a-word-of-10000-letters", "[0.5, 0.5, 0.5]", "\"LONG\""),
    ("albedo-of-vertices-without-colours", "[0.5, 0.5, 0.5]", "\"vertex\""),
    ("albedo-texture-missing", "[0.5, 0.5, 0.5]", "{ texture = \"gone.png\" }"),
    ("albedo-texture-no-picture", "[0.5, 0.5, 0.5]", "{ texture = \"square.ply\" }"),
    ("albedo-texture-a-number", "[0.5, 0.5, 0.5]", "{ texture = 5 }"),
    ("albedo-table-empty", "[0.5, 0.5, 0.5]", "{}"),
    ("albedo-table-of-unknown-key", "[0.5, 0.5, 0.5]", "{ image = \"gone.png\" }"),
    ("radiance-negative", "[0, 0, 0]\nsides", "[0, -1, 0]\nsides"),
    ("radiance-nan", "[0, 0, 0]\nsides", "[0, nan, 0]\nsides"),
    ("radiance-infinite", "[0, 0, 0]\nsides", "inf\nsides"),
    ("radiance-beyond-single", "[0, 0, 0]\nsides", "1e39\nsides"),
    ("radiance-of-1e38", "[0, 0, 0]\nsides", "1e38\nsides"),
    ("radiance-a-word", "[0, 0, 0]\nsides", "\"bright\"\nsides"),
    ("sides-3", "sides = 1", "sides = 3"),
    ("sides-fractional", "sides = 1", "sides = 1.5"),
    ("sides-beyond-integers", "sides = 1", "sides = 99999999999999999999"),
    ("scale-zero", "scale = 1.0", "scale = 0"),
    ("scale-zero-along-one-axis", "scale = 1.0", "scale = [1, 0, 1]"),
    ("scale-nan", "scale = 1.0", "scale = nan"),
    ("scale-of-two-numbers", "scale = 1.0", "scale = [1, 2]"),
    ("scale-of-1e308", "scale = 1.0", "scale = 1e308"),
    ("scale-of-1e-320", "scale = 1.0", "scale = 1e-320"),
    ("scale-of-1e-30-under-a-spot", "scale = 1.0", "scale = 1e-30"),
    ("scale-of-1e30-under-a-spot", "scale = 1.0", "scale = 1e30"),
    ("scale-misspelt", "scale = 1.0", "sclae = 1.0"),
    ("rotation-about-nothing", "[0, 1, 0, 30]", "[0, 0, 0, 30]"),
    ("rotation-of-three-numbers", "[0, 1, 0, 30]", "[0, 1, 0]"),
    ("rotation-by-nan", "[0, 1, 0, 30]", "[0, 1, 0, nan]"),
    ("translation-beyond-doubles", "translate = [0, 0, 0]", "translate = [0, 0, 1e400]"),
    ("translation-of-1e308", "translate = [0, 0, 0]", "translate = [0, 0, 1e308]"),
    ("translation-so-far-that-the-mesh-vanishes", "translate = [0, 0, 0]", "translate = [1e30, 1e30, 1e30]"),
    ("transform-a-number", "{ scale = 1.0, rotate = [0, 1, 0, 30], translate = [0, 0, 0] }", "3"),
    ("sky-empty", "radiance = [1, 1, 1]\n", ""),
    ("sky-misspelt", "[sky]", "[skye]"),
    ("sky-negative", "[1, 1, 1]", "[1, -1, 1]"),
    ("sky-of-1e38", "[1, 1, 1]", "1e38"),
    ("sky-file-missing", "radiance = [1, 1, 1]", "file = \"gone.exr\""),
    ("sky-file-of-unknown-kind", "radiance = [1, 1, 1]", "file = \"square.ply\""),
    ("sky-of-radiance-and-file", "radiance = [1, 1, 1]", "radiance = 1\nfile = \"square.ply\""),
    ("sky-constant-and-rotated", "radiance = [1, 1, 1]", "radiance = 1\nrotate = 30"),
    ("sky-up-unknown", "up = \"y\"", "up = \"w\""),
    ("sky-up-a-vector", "up = \"y\"", "up = [0, 1, 0]"),
    ("lamp-of-unknown-kind", "\"sun\"\ndirection", "\"moon\"\ndirection"),
    ("lamp-of-a-kind-of-10000-letters", "\"sun\"\ndirection", "\"LONG\"\ndirection"),
    ("lamp-without-kind", "kind = \"sun\"\n", ""),
    ("lamp-point-with-direction", "\"sun\"\ndirection", "\"point\"\ndirection"),
    ("sun-without-direction", "direction = [0.3, -1.0, 0.2]\n", ""),
    ("sun-of-direction-zero", "[0.3, -1.0, 0.2]", "[0, 0, 0]"),
    ("sun-of-direction-nan", "[0.3, -1.0, 0.2]", "[nan, -1.0, 0.2]"),
    ("sun-with-position", "irradiance = [3, 2.8, 2.5]", "irradiance = 3\nposition = [0, 0, 0]"),
    ("sun-without-irradiance", "irradiance = [3, 2.8, 2.5]\n", ""),
    ("sun-negative", "irradiance = [3, 2.8, 2.5]", "irradiance = [-3, 2.8, 2.5]"),
    ("sun-of-1e38", "irradiance = [3, 2.8, 2.5]", "irradiance = 1e38"),
    ("sun-with-intensity", "irradiance = [3, 2.8, 2.5]", "intensity = 3"),
    ("sun-key-misspelt", "irradiance =", "iradiance ="),
    ("spot-without-position", "position = [1, 2, 3]\n", ""),
    ("spot-at-nan", "position = [1, 2, 3]", "position = [1, nan, 3]"),
    ("spot-at-1e300", "position = [1, 2, 3]", "position = [1, 2, 1e300]"),
    ("spot-without-intensity", "intensity = 4\n", ""),
    ("spot-of-angle-0", "angle = 30", "angle = 0"),
    ("spot-of-angle-120", "angle = 30", "angle = 120"),
    ("spot-of-blend-2", "blend = 0.2", "blend = 2"),
    ("lamp-named-as-the-mesh", "name = \"sun\"", "name = \"wall\""),
    ("lamp-name-a-number", "name = \"sun\"", "name = 5"),
    ("mesh-names-doubled", "[sky]", "[[mesh]]\nfile = \"square.ply\"\nname = \"wall\"\n[sky]"),
    (
        "mesh-names-doubled-of-10000-letters",
        "name = \"wall\"",
        "name = \"LONG\"\n[[mesh]]\nfile = \"square.ply\"\nname = \"LONG\"",
    ),
    ("camera-that-sees-itself", "target = [2.78, 2.73, 0.0]", "target = [2.78, 2.73, -8.0]"),
    (
        "camera-that-nearly-sees-itself",
        "target = [2.78, 2.73, 0.0]",
        "target = [2.78, 2.73, -7.999999999999]",
    ),
    ("camera-at-1e300", "eye = [2.78, 2.73, -8.0]", "eye = [0, 0, 1e300]"),
    ("camera-without-target", "target = [2.78, 2.73, 0.0]\n", ""),
    ("camera-at-nan", "eye = [2.78, 2.73, -8.0]", "eye = [nan, 2.73, -8.0]"),
    ("camera-up-zero", "up = [0, 1, 0]", "up = [0, 0, 0]"),
    ("camera-up-along-the-view", "up = [0, 1, 0]", "up = [0, 0, 1]"),
    ("camera-fov-180", "fov = 39.3", "fov = 180"),
    ("camera-fov-0", "fov = 39.3", "fov = 0"),
    ("camera-fov-nan", "fov = 39.3", "fov = nan"),
    ("camera-fov-a-word", "fov = 39.3", "fov = \"wide\""),
    ("camera-of-no-pixels", "size = [512, 512]", "size = [512, 0]"),
    ("camera-of-negative-pixels", "size = [512, 512]", "size = [512, -1]"),
    ("camera-of-70000-pixels", "size = [512, 512]", "size = [70000, 70000]"),
    ("camera-of-one-size", "size = [512, 512]", "size = [512]"),
    ("camera-of-three-sizes", "size = [512, 512]", "size = [512, 512, 3]"),
];

fn whole(name: &str, bytes: impl AsRef<[u8]>) -> Case {
    scene(&format!("scene/{name}"), "scene.toml", bytes)
}

/// All of them.
pub fn cases() -> Vec<Case> {
    let long = "x".repeat(10_000);
    let beside = |case: Case| {
        case.with("square.ply", SQUARE_PLY)
            .with("square.stl", "solid\n")
            .with("broken.ply", "ply\nformat ascii 1.0\n")
    };
    let mut cases: Vec<Case> = CHANGES
        .iter()
        .map(|(name, there, instead)| {
            assert!(GOOD.contains(there), "{there:?} is in the scene");
            beside(whole(name, GOOD.replacen(there, &instead.replace("LONG", &long), 1)))
        })
        .collect();
    let zero_sky = "[[mesh]]\nfile = \"square.ply\"\n[sky]\nradiance = 0\n";
    cases.extend([
        whole("empty", ""),
        whole("mesh-missing", "[sky]\nradiance = 1\n"),
        whole("not-utf-8", b"# caf\xe9\n"),
        whole("in-utf-16", "[[mesh]]\n".encode_utf16().flat_map(u16::to_le_bytes).collect::<Vec<u8>>()),
        whole("zeros", vec![0; 5000]),
        whole("json", "{\"mesh\": []}\n"),
        whole("brackets-10000", format!("a = {}", "[".repeat(10_000))),
        whole("dotted-keys-10000", format!("{}a = 1\n", "a.".repeat(10_000))),
        beside(whole("dark", "[[mesh]]\nfile = \"square.ply\"\n")),
        beside(whole("dark-sky", zero_sky)),
        scene("name/of-unknown-kind", "solid.stl", "solid cube\n"),
        scene("name/without-extension", "mesh", SQUARE_PLY),
        Case::missing("name/missing", "gone.ply", Ask::Scene),
        Case::missing("name/a-folder", ".", Ask::Scene),
        Case::missing("name/in-a-missing-folder", "no/where.toml", Ask::Scene),
    ]);
    cases
}

//! Broken glTF and GLB files.

use crate::scene_shared::pictures;
use crate::scene_shared::{glb, small_glb, small_glb_parts};
use crate::{Case, scene};

/// Changes to the JSON of a good GLB: name, what is there, what stands there instead.
const CHANGES: &[(&str, &str, &str)] = &[
    ("json-cut", r#""buffers":[{"byteLength":92}]}"#, ""),
    ("json-with-trailing-comma", r#""scene":0,"#, r#""scene":0,,"#),
    ("asset-version-9", r#""version":"2.0""#, r#""version":"9.0""#),
    ("asset-missing", r#""asset":{"version":"2.0"},"#, ""),
    ("scene-missing", r#""scene":0,"#, r#""scene":7,"#),
    ("scene-without-roots", r#""scenes":[{"nodes":[0]}]"#, r#""scenes":[{"nodes":[]}]"#),
    ("root-missing", r#""scenes":[{"nodes":[0]}]"#, r#""scenes":[{"nodes":[99]}]"#),
    ("child-missing", r#""children":[1,2,3,4]"#, r#""children":[1,2,3,40]"#),
    ("child-twice", r#""children":[1,2,3,4]"#, r#""children":[1,1]"#),
    ("cycle", r#""children":[1,2,3,4]"#, r#""children":[0]"#),
    ("mesh-missing", r#""mesh":0"#, r#""mesh":5"#),
    ("scale-zero", r#""scale":[2,2,2]"#, r#""scale":[0,0,0]"#),
    ("scale-of-two-numbers", r#""scale":[2,2,2]"#, r#""scale":[2,2]"#),
    ("scale-beyond-single", r#""scale":[2,2,2]"#, r#""scale":[1e39,1,1]"#),
    ("scale-of-1e30", r#""scale":[2,2,2]"#, r#""scale":[1e30,1e30,1e30]"#),
    ("scale-of-1e-30", r#""scale":[2,2,2]"#, r#""scale":[1e-30,1e-30,1e-30]"#),
    ("rotation-zero", r#""rotation":[0,1,0,0]"#, r#""rotation":[0,0,0,0]"#),
    ("matrix-of-zeros", r#""scale":[2,2,2]"#, r#""matrix":[0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0]"#),
    ("light-missing", r#""light":0"#, r#""light":9"#),
    ("light-negative", r#""intensity":8"#, r#""intensity":-8"#),
    ("light-beyond-single", r#""intensity":8"#, r#""intensity":1e39"#),
    ("light-of-1e38", r#""intensity":8"#, r#""intensity":1e38"#),
    ("light-of-unknown-kind", r#""type":"point""#, r#""type":"area""#),
    ("cone-inside-out", r#""innerConeAngle":0.2"#, r#""innerConeAngle":0.9"#),
    ("cone-too-wide", r#""outerConeAngle":0.4"#, r#""outerConeAngle":2"#),
    ("camera-missing", r#""camera":0"#, r#""camera":3"#),
    ("camera-of-no-view", r#""yfov":0.7"#, r#""yfov":0"#),
    ("camera-of-unknown-kind", r#""cameras":[{"type":"perspective""#, r#""cameras":[{"type":"fisheye""#),
    ("primitive-without-positions", r#""POSITION":0,"#, ""),
    ("primitive-of-lines", r#""indices":2,"#, r#""indices":2,"mode":1,"#),
    ("primitive-of-unknown-mode", r#""indices":2,"#, r#""indices":2,"mode":77,"#),
    ("primitives-empty", r#""meshes":[{"primitives":["#, r#""meshes":[{"primitives":[]},{"primitives":["#),
    ("positions-in-no-accessor", r#""POSITION":0"#, r#""POSITION":12"#),
    ("positions-of-texture-coordinates", r#""POSITION":0"#, r#""POSITION":1"#),
    (
        "positions-of-integers",
        r#""componentType":5126,"count":4,"type":"VEC3""#,
        r#""componentType":5125,"count":4,"type":"VEC3""#,
    ),
    (
        "component-of-unknown-kind",
        r#""componentType":5126,"count":4,"type":"VEC3""#,
        r#""componentType":9,"count":4,"type":"VEC3""#,
    ),
    (
        "texture-coordinates-of-another-count",
        r#""bufferView":1,"componentType":5126,"count":4"#,
        r#""bufferView":1,"componentType":5126,"count":2"#,
    ),
    ("indices-in-no-accessor", r#""indices":2"#, r#""indices":12"#),
    ("indices-of-floats", r#""componentType":5123"#, r#""componentType":5126"#),
    ("indices-beyond-the-view", r#""count":6"#, r#""count":7"#),
    ("indices-1e12", r#""count":6"#, r#""count":1000000000000"#),
    ("indices-zero", r#""count":6"#, r#""count":0"#),
    ("indices-negative-count", r#""count":6"#, r#""count":-6"#),
    ("accessor-without-data", r#"{"bufferView":2,"componentType":5123"#, r#"{"componentType":5123"#),
    ("accessor-offset-beyond", r#"{"bufferView":2,"#, r#"{"bufferView":2,"byteOffset":4000000000,"#),
    (
        "accessor-offset-2e64-less-1",
        r#"{"bufferView":2,"#,
        r#"{"bufferView":2,"byteOffset":18446744073709551615,"#,
    ),
    ("accessor-in-no-view", r#"{"bufferView":2,"#, r#"{"bufferView":22,"#),
    ("view-beyond-the-buffer", r#""byteOffset":80,"byteLength":12"#, r#""byteOffset":80,"byteLength":99"#),
    (
        "view-offset-2e64-less-1",
        r#""byteOffset":80,"byteLength":12"#,
        r#""byteOffset":18446744073709551615,"byteLength":12"#,
    ),
    (
        "view-stride-too-small",
        r#""byteOffset":0,"byteLength":48"#,
        r#""byteOffset":0,"byteLength":48,"byteStride":4"#,
    ),
    (
        "view-stride-of-1e9",
        r#""byteOffset":0,"byteLength":48"#,
        r#""byteOffset":0,"byteLength":48,"byteStride":1000000000"#,
    ),
    ("view-in-no-buffer", r#"{"buffer":0,"byteOffset":80"#, r#"{"buffer":3,"byteOffset":80"#),
    ("buffer-longer-than-the-chunk", r#""buffers":[{"byteLength":92}]"#, r#""buffers":[{"byteLength":920}]"#),
    (
        "buffer-of-1e15-bytes",
        r#""buffers":[{"byteLength":92}]"#,
        r#""buffers":[{"byteLength":1000000000000000}]"#,
    ),
    ("buffer-in-a-missing-file", r#"{"byteLength":92}"#, r#"{"byteLength":92,"uri":"gone.bin"}"#),
    ("buffer-in-a-short-file", r#"{"byteLength":92}"#, r#"{"byteLength":92,"uri":"short.bin"}"#),
    ("buffer-in-a-folder", r#"{"byteLength":92}"#, r#"{"byteLength":92,"uri":"."}"#),
    ("buffer-endless", r#"{"byteLength":92}"#, r#"{"byteLength":92,"uri":"/dev/zero"}"#),
    (
        "buffer-on-the-network",
        r#"{"byteLength":92}"#,
        r#"{"byteLength":92,"uri":"https://example.org/a.bin"}"#,
    ),
    (
        "buffer-of-broken-data",
        r#"{"byteLength":92}"#,
        r#"{"byteLength":92,"uri":"data:application/octet-stream;base64,A*A"}"#,
    ),
    (
        "buffer-of-data-without-comma",
        r#"{"byteLength":92}"#,
        r#"{"byteLength":92,"uri":"data:application/octet-stream;base64"}"#,
    ),
    (
        "buffer-of-short-data",
        r#"{"byteLength":92}"#,
        r#"{"byteLength":92,"uri":"data:application/octet-stream;base64,AAAA"}"#,
    ),
    ("buffer-named-with-escape-codes", r#"{"byteLength":92}"#, r#"{"byteLength":92,"uri":"\u001b[2J.bin"}"#),
    ("buffer-named-with-10000-letters", r#"{"byteLength":92}"#, r#"{"byteLength":92,"uri":"LONG"}"#),
    ("material-missing", r#""material":0"#, r#""material":4"#),
    ("albedo-of-2", "[0.5,0.25,0.125,1]", "[2,0.25,0.125,1]"),
    ("albedo-negative", "[0.5,0.25,0.125,1]", "[-1,0.25,0.125,1]"),
    ("emission-negative", r#""emissiveFactor":[1,0.5,0]"#, r#""emissiveFactor":[-1,0.5,0]"#),
    ("emission-of-1e38", r#""emissiveStrength":6"#, r#""emissiveStrength":1e38"#),
    ("emission-beyond-single", r#""emissiveStrength":6"#, r#""emissiveStrength":1e39"#),
    (
        "material-named-with-escape-codes",
        r#""name":"plaster","#,
        r#""name":"\u001b[31mplaster","emissiveTexture":{"index":9},"#,
    ),
    ("metal", r#""metallicFactor":0"#, r#""metallicFactor":1"#),
    (
        "extension-required-and-unknown",
        r#""extensionsUsed":["#,
        r#""extensionsRequired":["KHR_draco_mesh_compression"],"extensionsUsed":["#,
    ),
];

/// Sparse accessors in place of the positions' plain one.
const SPARSE: &[(&str, &str)] = &[
    (
        "sparse-sound",
        r#""sparse":{"count":1,"indices":{"bufferView":2,"componentType":5123},"values":{"bufferView":1}},"#,
    ),
    (
        "sparse-count-beyond",
        r#""sparse":{"count":9,"indices":{"bufferView":2,"componentType":5123},"values":{"bufferView":1}},"#,
    ),
    (
        "sparse-indices-descend",
        r#""sparse":{"count":2,"indices":{"bufferView":2,"byteOffset":4,"componentType":5123},"values":{"bufferView":1}},"#,
    ),
    (
        "sparse-index-of-no-entry",
        r#""sparse":{"count":1,"indices":{"bufferView":1,"byteOffset":8,"componentType":5125},"values":{"bufferView":1}},"#,
    ),
    (
        "sparse-values-beyond",
        r#""sparse":{"count":2,"indices":{"bufferView":2,"componentType":5123},"values":{"bufferView":1,"byteOffset":20}},"#,
    ),
    (
        "sparse-in-no-view",
        r#""sparse":{"count":1,"indices":{"bufferView":77,"componentType":5123},"values":{"bufferView":1}},"#,
    ),
    (
        "sparse-indices-of-floats",
        r#""sparse":{"count":1,"indices":{"bufferView":2,"componentType":5126},"values":{"bufferView":1}},"#,
    ),
];

/// Textures of the material, with the picture that the file holds beside it.
const TEXTURES: &[(&str, &str)] = &[
    ("texture-missing", r#""textures":[{"source":0}],"images":[{"uri":"gone.png"}],"#),
    ("texture-without-image", r#""textures":[{"source":3}],"images":[{"uri":"grey.png"}],"#),
    ("texture-no-picture", r#""textures":[{"source":0}],"images":[{"uri":"short.bin"}],"#),
    ("texture-cut", r#""textures":[{"source":0}],"images":[{"uri":"cut.png"}],"#),
    ("texture-endless", r#""textures":[{"source":0}],"images":[{"uri":"/dev/zero"}],"#),
    ("texture-claims-65535-squared", r#""textures":[{"source":0}],"images":[{"uri":"huge.png"}],"#),
    (
        "texture-in-no-view",
        r#""textures":[{"source":0}],"images":[{"bufferView":9,"mimeType":"image/png"}],"#,
    ),
    (
        "texture-of-numbers",
        r#""textures":[{"source":0}],"images":[{"bufferView":0,"mimeType":"image/png"}],"#,
    ),
    (
        "texture-of-unknown-kind",
        r#""textures":[{"source":0}],"images":[{"bufferView":0,"mimeType":"image/webp"}],"#,
    ),
    (
        "texture-of-broken-data",
        r#""textures":[{"source":0}],"images":[{"uri":"data:image/png;base64,A*A"}],"#,
    ),
    ("texture-of-data-without-kind", r#""textures":[{"source":0}],"images":[{"uri":"data:;base64,AAAA"}],"#),
    ("texture-in-a-view-without-kind", r#""textures":[{"source":0}],"images":[{"bufferView":0}],"#),
    ("texture-neither-file-nor-view", r#""textures":[{"source":0}],"images":[{}],"#),
];

fn beside(case: Case) -> Case {
    case.with("short.bin", vec![0; 50])
        .with("grey.png", pictures::png(2, 2))
        .with("cut.png", &pictures::png(2, 2)[..50])
        .with("huge.png", pictures::png_claiming(65_535, 65_535))
}

fn containers() -> Vec<Case> {
    let good = small_glb();
    let with = |at: usize, value: u32| {
        let mut bytes = good.clone();
        bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
        bytes
    };
    let json = u32::from_le_bytes([good[12], good[13], good[14], good[15]]) as usize;
    let (text, numbers) = small_glb_parts();
    let floats = |at: usize, value: f32| {
        let mut numbers = numbers.clone();
        numbers[at..at + 4].copy_from_slice(&value.to_le_bytes());
        glb(&text, &numbers)
    };
    let mut index = numbers.clone();
    index[80] = 4;
    let textured = text
        .replace(r#""metallicFactor":0"#, r#""metallicFactor":0,"baseColorTexture":{"index":0}"#)
        .replace(
            r#""accessors":["#,
            r#""textures":[{"source":0}],"images":[{"uri":"grey.png"}],"accessors":["#,
        );
    let mut nan_uv = numbers.clone();
    nan_uv[48..52].copy_from_slice(&f32::NAN.to_le_bytes());
    let cases: Vec<(&str, Vec<u8>)> = vec![
        ("empty", Vec::new()),
        ("magic-alone", b"glTF".to_vec()),
        ("cut-in-the-header", good[..15].to_vec()),
        ("cut-in-the-json", good[..200].to_vec()),
        ("cut-in-the-numbers", good[..good.len() - 30].to_vec()),
        ("cut-before-the-numbers", good[..20 + json].to_vec()),
        ("version-1", with(4, 1)),
        ("version-99", with(4, 99)),
        ("length-zero", with(8, 0)),
        ("length-2e32-less-1", with(8, u32::MAX)),
        ("length-one-less", with(8, good.len() as u32 - 1)),
        ("json-chunk-length-zero", with(12, 0)),
        ("json-chunk-length-2e32-less-1", with(12, u32::MAX)),
        ("json-chunk-of-unknown-kind", with(16, 7)),
        ("numbers-chunk-length-2e32-less-1", with(20 + json, u32::MAX)),
        ("numbers-chunk-length-zero", with(20 + json, 0)),
        ("numbers-chunk-of-unknown-kind", with(24 + json, 7)),
        ("position-nan", floats(12, f32::NAN)),
        ("position-infinite", floats(0, f32::INFINITY)),
        ("position-of-1e38", floats(12, 1e38)),
        ("index-of-no-vertex", glb(&text, &index)),
        ("texture-coordinate-nan", glb(&textured, &nan_uv)),
        ("zeros", vec![0; 5000]),
        (
            "json-not-utf-8",
            glb("{\"asset\":{\"version\":\"\u{fffd}", b"")
                .into_iter()
                .map(|b| if b == 0xbd { 0xff } else { b })
                .collect(),
        ),
        ("json-of-10000-brackets", glb(&"[".repeat(10_000), b"")),
        ("an-empty-object", glb("{}", b"")),
    ];
    cases.into_iter().map(|(name, bytes)| beside(scene(&format!("glb/{name}"), "bad.glb", bytes))).collect()
}

/// All of them.
pub fn cases() -> Vec<Case> {
    let (json, numbers) = small_glb_parts();
    let made = |name: &str, there: &str, instead: &str| {
        assert!(json.contains(there), "{there} is in the file");
        let text = json.replacen(there, &instead.replace("LONG", &"x".repeat(10_000)), 1);
        beside(scene(&format!("gltf/{name}"), "bad.glb", glb(&text, &numbers)))
    };
    let mut cases: Vec<Case> =
        CHANGES.iter().map(|(name, there, instead)| made(name, there, instead)).collect();
    let plain = r#"{"bufferView":0,"componentType":5126,"count":4"#;
    cases.extend(SPARSE.iter().map(|(name, sparse)| {
        made(name, plain, &format!("{{\"bufferView\":0,{sparse}\"componentType\":5126,\"count\":4"))
    }));
    cases.extend(TEXTURES.iter().map(|(name, tables)| {
        let factor = r#""metallicFactor":0"#;
        let text = json.replacen(factor, r#""metallicFactor":0,"baseColorTexture":{"index":0}"#, 1).replacen(
            r#""accessors":["#,
            &format!(r#"{tables}"accessors":["#),
            1,
        );
        beside(scene(&format!("gltf/{name}"), "bad.glb", glb(&text, &numbers)))
    }));
    cases.push(scene("gltf/text-of-a-ply", "bad.gltf", "ply\nformat ascii 1.0\n"));
    cases.push(scene("gltf/text-without-buffer-file", "bad.gltf", json));
    cases.extend(containers());
    cases
}

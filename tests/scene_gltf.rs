//! glTF: transforms, materials, lamps, cameras; and what is wrong with broken ones.

mod scene_shared;

use glam::{DVec3, Vec3};
use glowtree::Error;
use glowtree::scene::{Albedo, LampKind};
use scene_shared::{Folder, glb, small_glb, small_glb_parts};

/// Positions are sums and products of small integers; only the division by the scene's scale rounds.
const CLOSE: f64 = 1e-6;

#[test]
fn a_small_scene_is_read_whole() {
    let scene = Folder::new().load("s.glb", small_glb()).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(scene.triangles, [[0, 1, 2], [0, 2, 3]]);
    let world: Vec<DVec3> = scene.vertices.iter().map(|&v| scene.placement.to_world(v)).collect();
    let expected = [(0., 0.), (2., 0.), (2., 2.), (0., 2.)].map(|(x, y)| DVec3::new(x, y, 6.0));
    assert!(world.iter().zip(expected).all(|(a, b)| (*a - b).length() < CLOSE), "{world:?}");
    let mesh = &scene.meshes[0];
    assert_eq!((mesh.name.as_str(), mesh.two_sided), ("wall", true));
    assert!(matches!(mesh.albedo, Albedo::Constant(c) if c == Vec3::new(0.5, 0.25, 0.125)));
    assert_eq!(mesh.radiance, Vec3::new(6.0, 3.0, 0.0), "factor times strength");
    assert!(scene.sky.is_none(), "a file with lights gets no sky");

    let names: Vec<&str> = scene.lamps.iter().map(|lamp| lamp.name.as_str()).collect();
    assert_eq!(names, ["bulb", "beam"]);
    let LampKind::Point { position, intensity } = scene.lamps[0].kind else { panic!("a point") };
    assert!((scene.placement.to_world(position) - DVec3::splat(2.0)).length() < CLOSE);
    // The square is 2 units wide, so one local unit is 2: intensities shrink by 4.
    assert!((intensity - Vec3::new(2.0, 1.0, 0.5)).length() < 1e-6, "{intensity}");
    let LampKind::Spot { direction, inner_cosine, outer_cosine, .. } = scene.lamps[1].kind else {
        panic!("a spot")
    };
    assert!((direction - Vec3::Z).length() < 1e-6, "-z turned half round y: {direction}");
    assert!((inner_cosine - 0.2f32.cos()).abs() < 1e-6 && (outer_cosine - 0.4f32.cos()).abs() < 1e-6);

    let camera = &scene.cameras[0];
    assert!((scene.placement.to_world(camera.eye) - DVec3::new(0., 0., 18.)).length() < 1e-5);
    assert_eq!((camera.name.as_str(), camera.size), ("eye", [1080, 720]));
    assert!((camera.fov_degrees - 0.7f32.to_degrees()).abs() < 1e-4);
}

#[test]
fn a_texture_becomes_the_albedo() {
    let folder = Folder::new();
    let mut picture = image::RgbImage::new(2, 1);
    picture.put_pixel(0, 0, image::Rgb([128, 0, 0]));
    picture.put_pixel(1, 0, image::Rgb([255, 255, 255]));
    picture.save(folder.write("p.png", "")).unwrap();
    let (json, binary) = small_glb_parts();
    let json = json
        .replace("\"metallicFactor\":0", "\"metallicFactor\":1,\"baseColorTexture\":{\"index\":0}")
        .replace("\"cameras\"", "\"textures\":[{\"source\":0}],\"images\":[{\"uri\":\"p.png\"}],\"cameras\"");
    let scene = folder.load("t.glb", glb(&json, &binary)).unwrap_or_else(|e| panic!("{e}"));
    // u = 0.25 is the first pixel's centre, at 1/4 of the way along the square's bottom edge; the factor is 0.5.
    let red = scene.albedo(0, 0.25, 0.0);
    let expected = 0.5 * glowtree::light::srgb_to_linear(128);
    assert!((red - Vec3::new(expected, 0.0, 0.0)).length() < 1e-6, "{red}");
    let said = format!("{:?}", scene.warnings);
    assert!(said.contains("plaster (metal)") && said.contains("1 white pixels"), "{said}");
}

#[test]
fn mirrored_parts_keep_their_fronts() {
    let (json, binary) = small_glb_parts();
    let mirrored = glb(&json.replace("\"scale\":[2,2,2]", "\"scale\":[-2,2,2]"), &binary);
    let scene = Folder::new().load("m.glb", mirrored).unwrap();
    // The square looks along +z; mirroring x must not turn it over.
    assert!((scene.normal(0) - Vec3::Z).length() < 1e-6, "{}", scene.normal(0));
}

/// Documents made from the good one by one replacement, and what the answer names.
const DOCUMENTS: &[(&str, &str, &[&str])] = &[
    ("\"indices\":2", "\"indices\":7", &["glTF"]),
    ("\"POSITION\":0", "\"POSITION\":9", &["mesh 0", "accessor 9 does not exist"]),
    ("\"POSITION\":0", "\"POSITION\":2", &["glTF"]),
    ("\"POSITION\":0", "\"POSITION\":1", &["glTF"]),
    ("\"TEXCOORD_0\":1", "\"TEXCOORD_0\":0", &["TexCoords", "not allowed here"]),
    ("\"count\":4,\"type\":\"VEC3\"", "\"count\":5,\"type\":\"VEC3\"", &["mesh 0", "beyond its buffer"]),
    ("\"count\":4,\"type\":\"VEC3\"", "\"count\":0,\"type\":\"VEC3\"", &["mesh 0", "claims 0"]),
    ("\"count\":4,\"type\":\"VEC3\"", "\"count\":4000000000000,\"type\":\"VEC3\"", &["claims 4000000000000"]),
    ("\"count\":6", "\"count\":7", &["mesh 0", "beyond its buffer"]),
    ("\"count\":6", "\"count\":-6", &["glTF"]),
    ("\"componentType\":5123", "\"componentType\":5126", &["accessor 2", "not allowed here"]),
    ("\"componentType\":5123", "\"componentType\":1", &["glTF"]),
    ("\"byteOffset\":80", "\"byteOffset\":90", &["beyond its buffer"]),
    ("\"byteOffset\":80", "\"byteOffset\":18446744073709551615", &["beyond its buffer"]),
    ("\"bufferView\":0,", "", &["glTF", "bufferView"]),
    ("\"bufferView\":0,", "\"bufferView\":8,", &["glTF"]),
    ("\"byteLength\":92", "\"byteLength\":920", &["buffer 0", "920"]),
    ("\"byteLength\":92", "\"byteLength\":92,\"uri\":\"gone.bin\"", &["buffer 0", "gone.bin does not exist"]),
    (
        "\"byteLength\":92",
        "\"byteLength\":92,\"uri\":\"http://a/b\"",
        &["buffer 0", "neither a relative file"],
    ),
    ("\"byteLength\":92", "\"byteLength\":92,\"uri\":\"%ff%fe\"", &["buffer 0", "not UTF-8"]),
    ("\"byteLength\":92", "\"byteLength\":92,\"uri\":\"data:x;base64,%%%\"", &["buffer 0", "base64"]),
    ("\"children\":[1,2,3,4]", "\"children\":[1,2,3,0]", &["node 0", "its own ancestor"]),
    ("\"children\":[1,2,3,4]", "\"children\":[1,1]", &["node 1", "two parents"]),
    ("\"children\":[1,2,3,4]", "\"children\":[9]", &["glTF"]),
    ("\"children\":[1,2,3,4]", "\"children\":[]", &["no triangles"]),
    ("\"scale\":[2,2,2]", "\"scale\":[1e39,2,2]", &["node 0"]),
    ("\"scale\":[2,2,2]", "\"scale\":[0,0,0]", &["one point"]),
    ("\"mesh\":0", "\"mesh\":1", &["glTF"]),
    ("\"light\":0", "\"light\":9", &["glTF"]),
    ("\"intensity\":8", "\"intensity\":-8", &["light 0", "negative"]),
    ("\"outerConeAngle\":0.4", "\"outerConeAngle\":0.1", &["light 1", "cone angles"]),
    ("[0.5,0.25,0.125,1]", "[1.5,0.25,0.125,1]", &["plaster", "baseColorFactor", "outside [0, 1)"]),
    ("[0.5,0.25,0.125,1]", "[-0.5,0.25,0.125,1]", &["plaster", "baseColorFactor"]),
    ("\"emissiveStrength\":6", "\"emissiveStrength\":-6", &["plaster", "emission", "negative"]),
    ("\"emissiveStrength\":6", "\"emissiveStrength\":1e60", &["plaster", "emission"]),
    ("\"material\":0", "\"material\":0,\"mode\":1", &["no triangles"]),
    ("\"material\":0", "\"material\":3", &["glTF"]),
    (
        "\"asset\":{\"version\":\"2.0\"}",
        "\"asset\":{\"version\":\"2.0\"},\"extensionsRequired\":[\"KHR_draco_mesh_compression\"]",
        &["glTF"],
    ),
    ("\"scene\":0", "\"scene\":4", &["glTF"]),
];

#[test]
fn broken_documents_get_their_answers() {
    let folder = Folder::new();
    let (json, binary) = small_glb_parts();
    for (good, bad, texts) in DOCUMENTS {
        assert!(json.contains(good), "{good} is in the document");
        let answer = folder.load("bad.glb", glb(&json.replacen(good, bad, 1), &binary));
        let Err(Error::Input { place, problem, .. }) = answer else {
            panic!("{good} -> {bad} gave {answer:?}")
        };
        let said = format!("{place}: {problem}");
        assert!(
            texts.iter().all(|text| said.contains(text)),
            "{good} -> {bad} should name {texts:?}: {said}"
        );
    }
    let mut nan = binary.clone();
    nan[12..16].copy_from_slice(&f32::NAN.to_le_bytes());
    let said = folder.load("nan.glb", glb(&json, &nan)).unwrap_err().to_string();
    assert!(said.contains("vertex 1 is not finite"), "{said}");
    let mut index = binary;
    index[80] = 4;
    let said = folder.load("index.glb", glb(&json, &index)).unwrap_err().to_string();
    assert!(said.contains("index 0 is vertex 4, out of range"), "{said}");
    for cut in [0, 3, 4, 11, 12, 19, 20, 30] {
        let answer = folder.load("cut.glb", &small_glb()[..cut]);
        assert_eq!(answer.unwrap_err().exit_code(), 4, "cut at {cut}");
    }
}

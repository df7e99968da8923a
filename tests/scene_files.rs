//! Every mesh and scene of the test data loads with the number of triangles that its README states.

mod scene_shared;

use glowtree::scene::{self, Albedo};
use scene_shared::{shared, triangles_in_file};

/// From the README of the meshes: file, triangles, vertices.
const MESHES: [(&str, usize, usize); 12] = [
    ("bunny-zipper.ply", 69_451, 35_947),
    ("lucy-100k.ply", 99_970, 49_987),
    ("nefertiti-70k.obj", 70_000, 35_002),
    ("igea-tristrips.ply", 268_686, 134_345),
    ("gargo-50k.ply", 50_000, 25_002),
    ("armadillo-86k.obj", 86_482, 43_243),
    ("turbineblade-199k.ply", 199_034, 99_519),
    ("rangemap-face-166k.ply", 166_259, 85_849),
    ("skull-100k.obj", 100_002, 49_999),
    ("mountain-51k.obj", 50_562, 25_600),
    ("egyptcat-16k.ply", 16_000, 10_049),
    ("ogre-124k.obj", 124_008, 62_194),
];

#[test]
fn meshes_load_with_their_counts() {
    let Some(folder) = shared("data/meshes") else { return };
    for (file, triangles, vertices) in MESHES {
        let scene = scene::load(&folder.join(file)).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(triangles_in_file(&scene), triangles, "triangles of {file}: {:?}", scene.warnings);
        assert_eq!(scene.vertices.len(), vertices, "vertices of {file}");
        assert_eq!(scene.meshes.len(), 1, "meshes of {file}");
        assert!(
            scene.meshes[0].two_sided && scene.sky.is_some(),
            "a bare scan is two-sided under a sky: {file}"
        );
        let corners = || scene.triangles.iter().flatten().map(|&v| scene.vertices[v as usize]);
        let (low, high) =
            corners().fold((glam::Vec3::MAX, glam::Vec3::MIN), |(low, high), p| (low.min(p), high.max(p)));
        // Both ends round once to f32 in a box of size one: 2^-24 each, and once more in the difference.
        assert!(((high - low).max_element() - 1.0).abs() < 2e-7, "{file} is normalised to {}", high - low);
        assert!((low + high).abs().max_element() < 2e-7, "{file} is centred at {}", low + high);
    }
}

#[test]
fn zero_area_triangles_are_counted_not_kept() {
    let Some(folder) = shared("data/meshes") else { return };
    let scene = scene::load(&folder.join("ogre-124k.obj")).expect("the ogre");
    assert_eq!(scene.triangles.len(), 124_008 - 4, "the README counts 4 zero-area triangles");
    assert!((0..scene.triangles.len() as u32).all(|id| scene.normal(id).is_normalized()));
}

#[test]
fn colours_of_a_scan_become_its_albedo() {
    let Some(folder) = shared("data/meshes") else { return };
    let scene = scene::load(&folder.join("gargo-50k.ply")).expect("the gargoyle");
    let Albedo::Vertex(colours) = &scene.meshes[0].albedo else { panic!("gargo has vertex colours") };
    assert_eq!(colours.len(), scene.vertices.len());
    assert!(colours.iter().all(|c| c.min_element() >= 0.0 && c.max_element() < 1.0));
    assert_eq!(scene.meshes[0].normals.as_ref().map(Vec::len), Some(scene.vertices.len()));
}

#[test]
fn scenes_load_with_their_counts() {
    let Some(folder) = shared("data/scenes") else { return };
    let totals = [
        ("luxcore-kitchen", 86_032),
        ("luxcore-cornell", 3_908),
        ("mitsuba-cbox/meshes", 38),
        ("mcguire-cornell", 32),
        ("sponza-dabrovic", 66_450),
        ("nori-table/meshes", 22_762),
    ];
    for (name, triangles) in totals {
        let mut sum = 0;
        for entry in std::fs::read_dir(folder.join(name)).expect(name) {
            let path = entry.expect(name).path();
            if path.extension().is_some_and(|e| e == "ply" || e == "obj") {
                sum += triangles_in_file(&scene::load(&path).unwrap_or_else(|error| panic!("{error}")));
            }
        }
        assert_eq!(sum, triangles, "{name}");
    }
    for file in ["cornell_box.obj", "cornell_box_multimaterial.obj"] {
        let scene = scene::load(&folder.join("embree-cornell").join(file)).expect(file);
        assert_eq!(scene.triangles.len(), 36, "{file}");
        let names: Vec<&str> = scene.meshes.iter().map(|mesh| mesh.name.as_str()).collect();
        assert!(names.contains(&"red") && names.contains(&"green") && names.contains(&"light"), "{names:?}");
    }
}

#[test]
fn reference_scenes_load_with_their_counts() {
    let Some(folder) = shared("reference") else { return };
    for (name, triangles) in
        [("cornell", 46), ("rooms", 136), ("scan", 327_684), ("sphere", 81_920), ("furnace", 12)]
    {
        let scene =
            scene::load(&folder.join(name).join("scene.toml")).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(triangles_in_file(&scene), triangles, "{name}: {:?}", scene.warnings);
        assert_eq!(scene.sky.is_some(), name == "scan", "the sky of {name}");
    }
}

/// tobj reads the same OBJ files without any code of ours.
#[test]
fn tobj_agrees_on_the_meshes() {
    let Some(folder) = shared("data/meshes") else { return };
    for file in ["armadillo-86k.obj", "skull-100k.obj", "nefertiti-70k.obj"] {
        let scene = scene::load(&folder.join(file)).expect(file);
        let (models, _) = tobj::load_obj(folder.join(file), &tobj::LoadOptions::default()).expect(file);
        assert_eq!(models.len(), 1, "{file} is one mesh of triangles");
        let mesh = &models[0].mesh;
        assert_eq!(mesh.indices.len(), 3 * scene.triangles.len(), "{file}");
        // tobj numbers vertices anew, so corners are compared by where they are.
        for (theirs, ours) in mesh.indices.iter().zip(scene.triangles.iter().flatten()) {
            let theirs = glam::Vec3::from_slice(&mesh.positions[3 * *theirs as usize..]).as_dvec3();
            // They round world coordinates to f32, up to three box sizes off the origin: 3 * 2^-24 of the box in
            // each axis, and we round once more.
            let apart = (scene.placement.to_local(theirs) - scene.vertices[*ours as usize]).length();
            assert!(apart < 4e-7, "{file}: {theirs} is {apart} apart");
        }
    }
}

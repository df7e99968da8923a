//! Scene files: what is asked for is what comes out.

mod scene_shared;

use glam::{DVec3, Vec3};
use glowtree::scene::{Albedo, LampKind, Scene, Sky};
use scene_shared::{Folder, SQUARE_PLY};

fn load(toml: &str) -> Scene {
    let folder = Folder::new();
    folder.write("a.ply", SQUARE_PLY);
    folder.write("b.ply", SQUARE_PLY.replace("1 1 0", "1 1 1"));
    let mut picture = image::RgbImage::new(1, 2);
    picture.put_pixel(0, 1, image::Rgb([255, 0, 0]));
    picture.save(folder.write("p.png", "")).expect("writing a picture");
    let head = "property float z\nproperty float s\nproperty float t";
    let mut mapped = SQUARE_PLY.replace("property float z", head);
    for (row, uv) in [("0 0 0", "0 0"), ("1 0 0", "1 0"), ("1 1 0", "1 1"), ("0 1 0", "0 1")] {
        mapped = mapped.replace(&format!("\n{row}\n"), &format!("\n{row} {uv}\n"));
    }
    folder.write("uv.ply", mapped);
    let materials = "newmtl lamp\nKd 0.5 0.5 0.5\nKe 3 2 1\nnewmtl wall\nKd 0.25 0.5 0.75\n";
    folder.write("two.mtl", materials);
    folder.write(
        "two.obj",
        "mtllib two.mtl\nv 9 9 9\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 5 5 5\nusemtl wall\nf 2 3 4\nusemtl lamp\nf 5 4 3\nusemtl wall\nf 4 3 2\n",
    );
    folder.load("scene.toml", toml).unwrap_or_else(|error| panic!("{error}"))
}

fn world(scene: &Scene, vertex: usize) -> DVec3 {
    scene.placement.to_world(scene.vertices[vertex])
}

#[test]
fn meshes_keep_their_order_and_their_properties() {
    let scene = load(
        "[[mesh]]\nfile = \"b.ply\"\nalbedo = [0.1, 0.2, 0.3]\nradiance = [4, 5, 6]\nsides = 1\nname = \"lit\"\n\
         [[mesh]]\nfile = \"a.ply\"\n[[mesh]]\nfile = \"a.ply\"\nalbedo = 0.25\n",
    );
    let names: Vec<&str> = scene.meshes.iter().map(|mesh| mesh.name.as_str()).collect();
    assert_eq!(names, ["lit", "a", "a-2"]);
    assert_eq!(scene.meshes[1].triangles, 2..4);
    assert_eq!(scene.meshes[1].vertices, 4..8);
    assert_eq!(scene.triangles[2], [4, 5, 6]);
    assert!(!scene.meshes[0].two_sided && scene.meshes[1].two_sided);
    assert_eq!(scene.meshes[0].radiance, Vec3::new(4., 5., 6.));
    assert_eq!(scene.albedo(1, 0.2, 0.2), Vec3::new(0.1, 0.2, 0.3));
    assert_eq!(scene.albedo(2, 0.2, 0.2), Vec3::splat(0.7), "grey without any albedo");
    assert_eq!(scene.albedo(5, 0.2, 0.2), Vec3::splat(0.25), "one number is grey");
    assert!(scene.sky.is_none() && scene.warnings.is_empty(), "{:?}", scene.warnings);
}

#[test]
fn transforms_scale_then_rotate_then_translate() {
    let scene = load(
        "[[mesh]]\nfile = \"a.ply\"\nradiance = 1\ntransform = { scale = 2, rotate = [0, 0, 3, 90], translate = [10, 0, 0] }\n",
    );
    // (1, 0, 0) -> (2, 0, 0) -> (0, 2, 0) -> (10, 2, 0); f32 steps of a box of size 2 are 2^-23.
    assert!((world(&scene, 1) - DVec3::new(10., 2., 0.)).length() < 3e-7, "{}", world(&scene, 1));
    let mirrored = load("[[mesh]]\nfile = \"a.ply\"\nradiance = 1\ntransform = { scale = [1, 1, -1] }\n");
    assert!((mirrored.normal(0) + Vec3::Z).length() < 1e-6, "the front is mirrored with the rest");
}

#[test]
fn textures_are_seen_through_the_uv() {
    let scene = load("[[mesh]]\nfile = \"uv.ply\"\nalbedo = { texture = \"p.png\" }\n[sky]\nradiance = 1\n");
    // PLY counts v upwards: v = 1/4 (y = 1/4 of the square) is the middle of the lower row, which is red.
    let lower = scene.albedo(0, 0.25, 0.25);
    assert!((lower - Vec3::new(0.999, 0., 0.)).length() < 1e-6, "{lower}");
}

#[test]
fn obj_materials_become_meshes() {
    let scene = load("[[mesh]]\nfile = \"two.obj\"\nname = \"room\"\n");
    let names: Vec<&str> = scene.meshes.iter().map(|mesh| mesh.name.as_str()).collect();
    assert_eq!(names, ["room/wall", "room/lamp"]);
    assert_eq!((scene.meshes[0].triangles.clone(), scene.meshes[1].triangles.clone()), (0..2, 2..3));
    assert!(matches!(scene.meshes[0].albedo, Albedo::Constant(c) if c == Vec3::new(0.25, 0.5, 0.75)));
    assert_eq!(scene.meshes[1].radiance, Vec3::new(3., 2., 1.));
    assert_eq!(scene.triangles, [[0, 1, 2], [2, 1, 0], [5, 4, 3]], "vertices in file order, per material");
}

#[test]
fn lamps_cameras_and_sky_are_local() {
    let scene = load(
        "[[mesh]]\nfile = \"a.ply\"\ntransform = { scale = 10 }\n[sky]\nradiance = [1, 2, 3]\nup = \"z\"\n\
         [[lamp]]\nkind = \"point\"\nposition = [5, 5, 10]\nintensity = [100, 200, 300]\n\
         [[lamp]]\nkind = \"spot\"\nposition = [5, 5, 10]\ndirection = [0, 0, -2]\nintensity = 100\nangle = 60\nblend = 0.5\n\
         [[lamp]]\nkind = \"sun\"\nname = \"sun\"\ndirection = [0, 0, -4]\nirradiance = 7\n\
         [[camera]]\neye = [5, 5, 20]\ntarget = [5, 5, 0]\n",
    );
    assert!(matches!(scene.sky, Some(Sky::Constant(c)) if c == Vec3::new(1., 2., 3.)));
    assert_eq!(scene.up, Vec3::Z);
    let LampKind::Point { position, intensity } = scene.lamps[0].kind else { panic!() };
    assert_eq!(position, Vec3::new(0., 0., 1.), "the box is 10 wide around (5, 5, 0)");
    assert!((intensity - Vec3::new(1., 2., 3.)).length() < 1e-6, "a hundredth: lengths are tenths");
    let LampKind::Spot { direction, inner_cosine, outer_cosine, .. } = scene.lamps[1].kind else { panic!() };
    assert_eq!(direction, Vec3::NEG_Z);
    assert!((outer_cosine - 0.5).abs() < 1e-6, "the angle is from the axis to the edge");
    assert!((inner_cosine - 30f32.to_radians().cos()).abs() < 1e-6);
    let LampKind::Sun { direction, irradiance } = scene.lamps[2].kind else { panic!() };
    assert_eq!((direction, irradiance), (Vec3::NEG_Z, Vec3::splat(7.0)), "irradiance knows no scale");
    let names: Vec<&str> = scene.lamps.iter().map(|lamp| lamp.name.as_str()).collect();
    assert_eq!(names, ["lamp", "lamp2", "sun"]);
    let camera = &scene.cameras[0];
    assert_eq!((camera.eye, camera.target, camera.up), (Vec3::new(0., 0., 2.), Vec3::ZERO, Vec3::Z));
}

//! Seeds of the corpus: small inputs of every kind, sound or nearly so, all made here.

use std::sync::Arc;

use glam::DAffine3;
use glowtree::archive::{Disk, Encoded, Storage, Tag, Writer, partial_path};
use glowtree::bake::transfer::codec;
use glowtree::detail::{CutParams, Shards, write};
use glowtree::light::Rgb;
use glowtree::scene::Placement;
use glowtree::scene::ply::stream::Stream;

use crate::readers::{Memory, SITES, archive_digests, chunks};
use crate::scene_shared::pictures::{exr, png, png_claiming};
use crate::scene_shared::{SQUARE_PLY, glb, small_glb, small_glb_parts};

/// Target, file name and bytes.
pub type Seed = (&'static str, &'static str, Vec<u8>);

/// All of them.
pub fn seeds() -> Vec<Seed> {
    let mut seeds = meshes();
    seeds.extend(gltfs());
    seeds.extend(scenes());
    seeds.extend(pictures());
    seeds.extend(archives());
    seeds.extend(details());
    seeds.extend(transfers());
    let table =
        "\u{feff}id, nx,ny,nz,x,y,z,note\r\n007,0,0,-2,1e3,-0.5, 3 ,\"a, \"\"b\"\"\"\r\n8,3,4,0,0,0,0,\r\n";
    seeds.push(("points", "quoted.csv", table.into()));
    seeds.push(("points", "plain.csv", "x,y,z,nx,ny,nz\n0,0,0,0,0,1\n1e-3,-2.5,3,0,1,0\n".into()));
    seeds
}

fn meshes() -> Vec<Seed> {
    let columns = "property double x\nproperty double y\nproperty double z\nproperty float nx\nproperty float ny\n\
                   property float nz\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n";
    let coloured = format!(
        "ply\nformat ascii 1.0\ncomment made here\nelement vertex 3\n{columns}element edge 1\nproperty int a\nproperty int b\n\
         element face 2\nproperty list uchar int vertex_indices\nproperty float quality\nend_header\n\
         0 0 0 0 0 1 9 9 9\n1 0 0 0 0 1 9 200 9\n.5 1. 0 0 0 1 255 9 9\n0 1\n3 0 1 2 0.5\n3 2 1 0 1e-3\n"
    );
    let binary = |format: &str, element: &str, big: bool, list: &[i32]| {
        let mut bytes = format!(
            "ply\r\nformat {format} 1.0\r\nelement vertex 4\r\nproperty float x\r\nproperty float y\r\nproperty float z\r\n\
             element {element} 1\r\nproperty list int int vertex_index\r\nend_header\r\n"
        )
        .into_bytes();
        let mut put = |word: u32| bytes.extend(if big { word.to_be_bytes() } else { word.to_le_bytes() });
        [0f32, 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.].iter().for_each(|f| put(f.to_bits()));
        list.iter().for_each(|i| put(*i as u32));
        bytes
    };
    let obj = "mtllib m.mtl\no a\nv 0 0 0 1 0 0\nv 1 0 0\nv 1 1 0 1\nv 0 1 0\nvt 0 0\nvt 1 1\nvn 0 0 1\nusemtl a\n\
               f 1/1/1 2/2/1 3/2/1 \\\n4/1/1\nusemtl b\nf -4//1 -3//1 -2//1\n#mtl\nnewmtl a\nKd 0.5 0.5 0.5\nKe 1 2 3\n\
               map_Kd -s 1 1 1 gone.png\nnewmtl b\nKd 1\nillum 2\nd 0.5\n";
    let concave = "v 0 0 0\nv 4 0 0\nv 4 4 0\nv 2 1 0\nv 0 4 0\nf 1 2 3 4 5\nf 1 1 2 2 3\nf 1 3 2 5\n";
    vec![
        ("ply", "square.ply", SQUARE_PLY.into()),
        ("ply", "coloured.ply", coloured.into()),
        ("ply", "little.ply", binary("binary_little_endian", "face", false, &[4, 0, 1, 2, 3])),
        ("ply", "big.ply", binary("binary_big_endian", "face", true, &[3, 0, 1, 2])),
        ("ply", "strips.ply", binary("binary_little_endian", "tristrips", false, &[7, 0, 1, 2, -1, 0, 2, 3])),
        ("ply", "carriage_returns.ply", SQUARE_PLY.replace('\n', "\r").into()),
        ("obj", "materials.obj", obj.into()),
        ("obj", "concave.obj", concave.into()),
    ]
}

fn gltfs() -> Vec<Seed> {
    let (json, numbers) = small_glb_parts();
    let sparse = json.replacen(
        r#"{"bufferView":0,"componentType":5126"#,
        r#"{"bufferView":0,"sparse":{"count":1,"indices":{"bufferView":2,"componentType":5123},"values":{"bufferView":1}},"componentType":5126"#,
        1,
    );
    let textured = json
        .replacen(r#""metallicFactor":0"#, r#""metallicFactor":0,"baseColorTexture":{"index":0}"#, 1)
        .replacen(
            r#""buffers":[{"byteLength":92}]"#,
            r#""buffers":[{"byteLength":92},{"byteLength":300}]"#,
            1,
        );
    let textured = textured.replacen(
        r#""accessors":["#,
        r#""textures":[{"source":0}],"images":[{"bufferView":3,"mimeType":"image/png"}],"accessors":["#,
        1,
    );
    let picture = png(2, 2);
    let textured = textured
        .replacen(r#""buffers":[{"byteLength":92},{"byteLength":300}]"#, &format!(r#""buffers":[{{"byteLength":{}}}]"#, 92 + picture.len()), 1)
        .replacen(
            r#"{"buffer":0,"byteOffset":80,"byteLength":12}"#,
            &format!(r#"{{"buffer":0,"byteOffset":80,"byteLength":12}},{{"buffer":0,"byteOffset":92,"byteLength":{}}}"#, picture.len()),
            1,
        );
    // Three corners of 0, 0, 0; 1, 0, 0; 0, 1, 0 in base64.
    let embedded = r#"{"asset":{"version":"2.0"},"nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"buffers":[{"byteLength":36,"uri":"data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"}],"bufferViews":[{"buffer":0,"byteLength":36}],"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}]}"#;
    vec![
        ("gltf", "small.glb", small_glb()),
        ("gltf", "sparse.glb", glb(&sparse, &numbers)),
        ("gltf", "textured.glb", glb(&textured, &[numbers, picture].concat())),
        ("gltf", "embedded.gltf", embedded.into()),
    ]
}

fn scenes() -> Vec<Seed> {
    let all = "[[mesh]]\nfile = \"square.ply\"\nalbedo = [0.5, 0.5, 0.5]\nradiance = 0\nsides = 1\nname = \"wall\"\n\
               transform = { scale = [1, 2, -1], rotate = [0, 1, 0, 30], translate = [0, 0, 5] }\n[[mesh]]\nfile = \"square.ply\"\n\
               albedo = \"vertex\"\n[sky]\nfile = \"sky.hdr\"\nrotate = 30\nup = \"-z\"\n[[lamp]]\nkind = \"sun\"\n\
               direction = [0.3, -1.0, 0.2]\nirradiance = [3, 2.8, 2.5]\n[[lamp]]\nkind = \"spot\"\nname = \"beam\"\n\
               position = [1, 2, 3]\ndirection = [0, -1, 0]\nintensity = 4\nangle = 30\nblend = 0.2\n[[lamp]]\nkind = \"point\"\n\
               position = [0, 0, 9]\nintensity = 1\n[[camera]]\nname = \"front\"\neye = [2.78, 2.73, -8.0]\n\
               target = [2.78, 2.73, 0.0]\nup = [0, 1, 0]\nfov = 39.3\nsize = [512, 512]\n";
    let dotted = "mesh = [{ file = 'square.ply', albedo = 0.25 }]\nsky.radiance = 1 # a comment\n";
    vec![("scene", "all.toml", all.into()), ("scene", "dotted.toml", dotted.into())]
}

fn pictures() -> Vec<Seed> {
    let written = |format| {
        let mut bytes = Vec::new();
        let picture = image::RgbImage::from_fn(8, 8, |x, y| image::Rgb([31 * x as u8, 31 * y as u8, 90]));
        picture.write_to(&mut std::io::Cursor::new(&mut bytes), format).expect("a picture in memory");
        bytes
    };
    let hdr = |data: &[u8]| [b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 8\n", data].concat();
    let runs = [2u8, 2, 0, 8, 136, 128, 136, 120, 136, 110, 136, 129].repeat(2);
    vec![
        ("picture", "gradient.exr", exr(8, 4, |x, y| x as f32 + 0.25 * y as f32)),
        ("picture", "sky.hdr", hdr(&[128, 128, 128, 129].repeat(16))),
        ("picture", "runs.hdr", hdr(&runs)),
        ("picture", "gradient.png", written(image::ImageFormat::Png)),
        ("picture", "gradient.jpg", written(image::ImageFormat::Jpeg)),
        ("picture", "claims.png", png_claiming(60_000, 60_000)),
    ]
}

fn archives() -> Vec<Seed> {
    let memory = Memory::default();
    let path = std::path::Path::new("sites.glow");
    let mut writer =
        Writer::create_in(Arc::new(memory.clone()), path, SITES, archive_digests()).expect("memory");
    writer.append(Tag::new("rows"), 0..9, &[1u64, 4, 9, 16, 25, 36, 49, 64, 81, 100]).expect("memory");
    writer.append(Tag::new("weights"), 0..3, &[1.0f32, 0.5, 0.25]).expect("memory");
    writer.checkpoint().expect("memory");
    let packed = Encoded { codec: 3, width_bytes: 4, raw_bytes: 400, bytes: b"delta" };
    writer.append_bytes(Tag::new("packed"), 0..100, packed).expect("memory");
    let unfinished = memory.bytes(&partial_path(path)).expect("a file");
    writer.finish(&[("program", "test")]).expect("memory");
    let finished = memory.bytes(path).expect("a file");
    vec![("archive", "finished.glow", finished), ("archive", "unfinished.glow", unfinished)]
}

/// Archives of two streamed meshes, one with colours, whole and as blocks alone.
fn transfers() -> Vec<Seed> {
    let seed = |values: &[Rgb]| [&(values.len() as u16).to_le_bytes()[..], &codec::encode(values)].concat();
    let smooth = |k: u16| Rgb::new(1.0, 0.5, 0.2) * (f32::from(k) / 40.0).sin();
    let wild = [Rgb::ZERO, Rgb::new(1.0e20, -3.0e10, 0.0), Rgb::splat(1.0e-20), Rgb::ONE];
    vec![
        ("transfer", "smooth", seed(&(0..300).map(smooth).collect::<Vec<_>>())),
        ("transfer", "wild", seed(&wild)),
        ("transfer", "dark", seed(&[Rgb::ZERO; 257])),
    ]
}

fn details() -> Vec<Seed> {
    let bumps = |coloured: bool| {
        let mut text = String::from(
            "ply\nformat ascii 1.0\nelement vertex 16\nproperty float x\nproperty float y\nproperty float z\n",
        );
        if coloured {
            text += "property uchar red\nproperty uchar green\nproperty uchar blue\n";
        }
        text += "element face 9\nproperty list uchar int vertex_indices\nend_header\n";
        for k in 0..16 {
            let colour = if coloured { format!(" {} 100 {}", 16 * k, 250 - 16 * k) } else { String::new() };
            text += &format!("{} {} {}{colour}\n", k % 4, k / 4, (k * k) % 3);
        }
        for k in (0..12).filter(|k| k % 4 < 3) {
            text += &format!("4 {} {} {} {}\n", k, k + 1, k + 5, k + 4);
        }
        text
    };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut seeds = Vec::new();
    for (coloured, names) in
        [(false, ["plain.glow", "plain.blocks"]), (true, ["tinted.glow", "tinted.blocks"])]
    {
        let mesh = folder.path().join("mesh.ply");
        std::fs::write(&mesh, bumps(coloured)).expect("writing the mesh");
        let archive = folder.path().join(names[0]);
        cut(&mesh, &archive).expect("cutting the mesh");
        seeds.push(("detail", names[0], std::fs::read(&archive).expect("the archive")));
        seeds.push(("detail", names[1], chunks::loose(&archive)));
    }
    seeds
}

/// Cuts a mesh into chunks of few triangles.
fn cut(mesh: &std::path::Path, archive: &std::path::Path) -> glowtree::Result<()> {
    let scratch = archive.with_extension("scratch");
    let pause = &|| Ok(());
    let params = CutParams { chunk_triangles: 16, proxy_triangles: 1000 };
    let stream = Stream::open(mesh, &scratch)?;
    let shards = Shards::make(&stream, &DAffine3::IDENTITY, &params, &scratch, pause)?;
    let [low, high] = shards.bounds();
    let placement = Placement { origin: low * 0.5 + high * 0.5, scale: (high - low).max_element() };
    let storage: Arc<dyn Storage> = Arc::new(Disk);
    write((&storage, archive), archive_digests(), (&stream, &shards, &placement), pause, |_| ())
}

//! Sabotage under valid checksums: each invariant is noticed, by the block that breaks it.

use bytemuck::{Pod, bytes_of, from_bytes};
use glowtree::archive::{Archive, Encoded, Tag, Writer};
use glowtree::bake::Silent;
use glowtree::bake::verify::repair;

use super::{Copy, baked, sealed};

/// Writes an archive anew with the payload of a tag's blocks changed, and valid checksums.
fn sabotage(copy: &Copy, kind: &str, tag: &str, change: impl Fn(&mut Vec<u8>)) {
    let path = copy.file(&format!("{kind}.glow"));
    let archive = Archive::open(&path).unwrap();
    let mut writer = Writer::create(&path, archive.kind(), archive.digests()).unwrap();
    for block in archive.all_blocks() {
        let entry = block.entry();
        if entry.tag != Tag::new(tag) {
            writer.append_copy(block).unwrap();
            continue;
        }
        let mut bytes = block.stored().unwrap().to_vec();
        change(&mut bytes);
        let raw_bytes = if entry.codec == 0 { bytes.len() as u64 } else { entry.raw_bytes };
        let payload =
            Encoded { codec: entry.codec, width_bytes: entry.width_bytes, raw_bytes, bytes: &bytes };
        writer.append_bytes(entry.tag, block.range(), payload).unwrap();
    }
    finish(writer, &archive);
}

fn finish(writer: Writer, archive: &Archive) {
    let provenance: Vec<(&str, &str)> =
        archive.provenance().iter().map(|(n, t)| (n.as_str(), t.as_str())).collect();
    writer.finish(&provenance).unwrap();
}

/// Changes one value of an array.
fn set<T: Pod>(at: usize, change: impl Fn(T) -> T) -> impl Fn(&mut Vec<u8>) {
    move |bytes| {
        let place = &mut bytes[at * size_of::<T>()..(at + 1) * size_of::<T>()];
        let mut aligned = T::zeroed();
        bytemuck::bytes_of_mut(&mut aligned).copy_from_slice(place);
        place.copy_from_slice(bytes_of(&change(*from_bytes::<T>(bytes_of(&aligned)))));
    }
}

type Change = Box<dyn Fn(&mut Vec<u8>)>;

fn cases() -> Vec<(&'static str, &'static str, &'static str, Change)> {
    let float = |f: fn(f32) -> f32| -> Change { Box::new(set(3, f)) };
    let word = |f: fn(u32) -> u32| -> Change { Box::new(set(3, f)) };
    vec![
        ("weights of a site sum to more than 1", "links", "fit_by", float(|w| w + 0.5)),
        ("a negative weight", "links", "fit_by", float(|_| -0.25)),
        ("a receiver that is not there", "links", "fit_to", word(|_| 1 << 30)),
        ("a receiver twice at a site", "links", "fit_to", Box::new(|b| b.copy_within(0..4, 4))),
        ("offsets that descend", "links", "fit_at", word(|_| u32::MAX)),
        ("offsets that begin later", "links", "lamp_at", Box::new(set(0, |_: u32| 1))),
        ("a ray too many", "links", "row_sums", Box::new(set(0, |hits: u32| hits + 1))),
        (
            "black backs that nothing met",
            "links",
            "row_sums",
            Box::new(set(0, |[h, d, _, e]: [u32; 4]| [h, d, h, e])),
        ),
        ("distances that are no numbers", "links", "row_sums", Box::new(set(1, |_: u32| f32::NAN.to_bits()))),
        ("a receiver without radius", "links", "radius", float(|_| 0.0)),
        ("a receiver on no site", "links", "receiver", word(|_| u32::MAX)),
        ("a receiver nowhere", "links", "point", Box::new(set(0, |_: f32| f32::INFINITY))),
        ("a receiver's long normal", "links", "point", Box::new(set(4, |y: f32| y + 1.5))),
        ("another row's key", "links", "row_key", Box::new(|b| b[..16].rotate_left(8))),
        ("rows that are too many", "links", "tables", Box::new(set(0, |n: u32| n + 1))),
        ("a cluster of lamps that is not there", "links", "lamp_to", word(|_| 77_777)),
        ("lamps seen more than all", "links", "lamp_by", Box::new(set(0, |_: f32| 1.5))),
        ("light that is lost", "links", "lamp_by", Box::new(set(1, |_: f32| f32::NAN))),
        ("a box beside its parent's", "scene", "branches", Box::new(set(0, |x: f32| x + 1.0))),
        ("a branch's child twice", "scene", "branches", Box::new(|b| b.copy_within(192..196, 196))),
        ("a corner that moved", "scene", "packets", Box::new(set(0, |x: f32| x + 0.25))),
        ("a triangle held twice", "scene", "packets", Box::new(|b| b.copy_within(144..148, 148))),
        ("a triangle that is not there", "scene", "packets", Box::new(set(36, |_: u32| 1 << 20))),
        ("a vertex nowhere", "scene", "vertices", float(|_| f32::NAN)),
        ("a site without area", "sites", "area", float(|_| f32::NAN)),
        ("a site of negative area", "sites", "area", float(|a| -a)),
        ("a site that reflects more than it gets", "sites", "albedo", float(|_| 1.5)),
        ("a site that glows darkness", "sites", "exitance", float(|_| -1.0)),
        ("a site nowhere", "sites", "position", float(|_| f32::NEG_INFINITY)),
        ("a site off its triangle", "sites", "position", float(|x| x + 1e-4)),
        ("a site's short normal", "sites", "normal", Box::new(set(0, |_: [f32; 3]| [0.0; 3]))),
        ("a site on no triangle", "sites", "triangle", word(|_| 1 << 25)),
        ("a site beside its triangle", "sites", "barycent", float(|_| 3.0)),
        ("a site's spacing", "sites", "spacing", float(|_| f32::NAN)),
        ("a neighbour that is not there", "sites", "graph_to", word(|_| u32::MAX)),
        ("neighbours in no order", "sites", "graph_at", word(|_| u32::MAX)),
        ("a doubtful flag", "sites", "unclean", Box::new(|b| b[3] = 7)),
        ("a plot that ends before it begins", "sites", "plot", Box::new(set(0, |_: u32| u32::MAX))),
        ("light that is no number", "light", "irradian", float(|_| f32::NAN)),
        ("negative light", "light", "irradian", float(|_| -1.0)),
        ("a gradient without end", "light", "gradient", float(|_| f32::INFINITY)),
        ("sky that no ray saw", "light", "sky_seen", float(|s| s + 0.125)),
        ("negative noise", "light", "noise", float(|_| -1.0)),
        ("no surplus", "light", "surplus", float(|_| f32::NAN)),
        ("a level without end", "light", "level", Box::new(set(0, |_: f32| f32::INFINITY))),
        ("radiosity from nowhere", "light", "radiosit", float(|b| 1.001 * b + 0.001)),
        ("an array cut short", "light", "noise", Box::new(|b| b.truncate(b.len() - 4))),
    ]
}

#[test]
fn each_sabotaged_invariant_is_noticed_by_its_block() {
    let cases = cases();
    for (what, kind, tag, change) in &cases {
        let copy = baked().copy();
        sabotage(&copy, kind, tag, change);
        let found = copy.verify().damages;
        // Rows are what their keys, points and sums say: looking at what they hold tells.
        let named = |d: &glowtree::bake::verify::Damage| {
            let tag_named = d.tag.as_deref() == Some(tag)
                || (["row_key", "row_sums"].contains(tag) && d.tag.as_deref() == Some("rows"));
            d.file == format!("{kind}.glow") && tag_named
        };
        assert!(found.iter().any(named), "{what}: {kind}.glow `{tag}`, found {found:?}");
    }
    println!("{} sabotaged invariants, all noticed", cases.len());
}

#[test]
fn sabotaged_blocks_are_baked_anew() {
    for (what, kind, tag, change) in
        cases().iter().filter(|case| ["fit_by", "branches", "area", "radiosit"].contains(&case.2))
    {
        let copy = baked().copy();
        sabotage(&copy, kind, tag, change);
        let (made, files, rebaked) = copy.repaired(what);
        assert!(rebaked && made >= 1 && files == 1, "{what}: {made} blocks of {files} files");
    }
}

#[test]
fn a_receiver_covered_twice_or_never_is_noticed() {
    for times in [0, 2] {
        for tag in ["rows", "order"] {
            let copy = baked().copy();
            let path = copy.file("links.glow");
            let archive = Archive::open(&path).unwrap();
            let mut writer = Writer::create(&path, archive.kind(), archive.digests()).unwrap();
            for block in archive.all_blocks() {
                for _ in 0..if block.entry().tag == Tag::new(tag) { times } else { 1 } {
                    writer.append_copy(block).unwrap();
                }
            }
            finish(writer, &archive);
            let found = copy.verify().damages;
            let told = found.iter().any(|d| d.problem.contains("expected") && d.to_string().contains(tag));
            assert!(told, "{tag} {times} times: {found:?}");
        }
    }
}

#[test]
fn figures_that_archives_contradict_are_noticed() {
    for figure in ["triangles", "vertices", "sites", "links"] {
        let copy = baked().copy();
        copy.edit("summary.json", |text| {
            let mut value: serde_json::Value = serde_json::from_slice(text).unwrap();
            value[figure] = (value[figure].as_u64().unwrap() + 1).into();
            *text = sealed(&serde_json::to_string_pretty(&value).unwrap());
        });
        let found = copy.verify().damages;
        assert!(found.len() == 1 && found[0].problem.contains(figure), "{found:?}");
        repair(&copy.job(), &copy.verify(), &Silent).unwrap();
        assert!(copy.verify().is_whole());
    }
}

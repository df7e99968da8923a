//! Every place of every file, damaged in every way: named, and made anew.

use std::fs;

use glowtree::archive::{Archive, Writer};
use glowtree::bake::Silent;
use glowtree::bake::verify::{ARCHIVES, repair};

use super::{baked, copy, sealed, spans};

#[test]
fn a_bit_in_each_part_of_each_block_is_named() {
    let (mut damaged, copy) = (0, baked().copy());
    for kind in ARCHIVES {
        let name = format!("{kind}.glow");
        for span in spans(kind).0 {
            let header = span.bytes.start + 8;
            let payload = span.payload.clone().nth(span.payload.len() / 2);
            let padding = (span.payload.end < span.bytes.end).then_some(span.bytes.end - 1);
            for at in [Some(header), payload, padding].into_iter().flatten() {
                let flip = |bytes: &mut Vec<u8>| bytes[at] ^= 16;
                copy.edit(&name, flip);
                let found = copy.verify().damages;
                copy.edit(&name, flip);
                let first = found.first().unwrap_or_else(|| panic!("{name}, byte {at}: not noticed"));
                assert_eq!(found.len(), 1, "{name}, byte {at}: one damage, not {found:?}");
                assert_eq!(
                    (first.file.as_str(), first.block, first.tag.as_deref()),
                    (name.as_str(), Some(span.number), Some(span.tag.as_str())),
                    "{first}"
                );
                assert!(first.problem.contains("expected"), "{first}");
                damaged += 1;
            }
        }
    }
    println!("{damaged} flipped bits in headers, payloads and paddings, all named");
}

#[test]
fn each_block_is_made_anew() {
    let (mut shot, mut baked_anew) = (0, 0);
    for kind in ARCHIVES {
        for span in spans(kind).0.iter().filter(|span| !span.payload.is_empty()) {
            let copy = baked().copy();
            copy.edit(&format!("{kind}.glow"), |bytes| bytes[span.payload.start] ^= 1);
            let (made, files, rebaked) = copy.repaired(&format!("{kind}.glow, {}", span.tag));
            assert_eq!((made, files), (1, 1), "{kind}.glow, {}", span.tag);
            assert_eq!(rebaked, !matches!(span.tag.as_str(), "rows" | "order"), "{}", span.tag);
            if rebaked { baked_anew += 1 } else { shot += 1 }
        }
    }
    println!("{shot} blocks of rows shot anew, {baked_anew} others baked anew, all byte by byte");
    assert!(shot >= 2);
}

#[test]
fn headers_and_paddings_are_written_anew_around_their_payloads() {
    let copy = baked().copy();
    let mut flipped = 0;
    for kind in ARCHIVES {
        copy.edit(&format!("{kind}.glow"), |bytes| {
            for span in spans(kind).0 {
                let padding = (span.payload.end < span.bytes.end).then_some(span.payload.end);
                for at in [Some(span.bytes.start + 20), padding].into_iter().flatten() {
                    bytes[at] ^= 2;
                    flipped += 1;
                }
            }
        });
    }
    let named = copy.verify().damages.iter().filter(|d| d.block.is_some()).count();
    assert_eq!(copy.repaired("all headers and paddings"), (0, 4, false));
    println!("{flipped} bits in headers and paddings of {named} blocks, mended without a bake");
}

#[test]
fn frames_are_mended_from_the_blocks_between() {
    let mut mended = 0;
    for kind in ARCHIVES {
        let name = format!("{kind}.glow");
        let (spans, directory) = spans(kind);
        let end = fs::metadata(baked().job().join(&name)).unwrap().len() as usize;
        let places =
            [0, 10, 30, 60, 4000, directory, (directory + end) / 2 - 32, end - 64, end - 30, end - 1];
        for at in places {
            let copy = baked().copy();
            copy.edit(&name, |bytes| bytes[at] ^= 1);
            let found = copy.verify().damages;
            assert!(
                found.iter().any(|d| d.file == name && d.block.is_none()),
                "{name}, byte {at}: {found:?}"
            );
            let (made, files, rebaked) = copy.repaired(&format!("{name}, byte {at}"));
            assert_eq!((made, files, rebaked), (0, 1, false), "{name}, byte {at}");
            mended += 1;
        }
        // The trailer alone cut off; a tail appended.
        for length in [end - 64, end - 1, end + 100] {
            let copy = baked().copy();
            copy.edit(&name, |bytes| bytes.resize(length, 0));
            assert!(!copy.verify().is_whole(), "{name} of {length} bytes");
            assert_eq!(copy.repaired(&format!("{name} of {length} bytes")), (0, 1, false));
            mended += 1;
        }
        // With a damaged block besides, blocks tell too little.
        let copy = baked().copy();
        copy.edit(&name, |bytes| {
            bytes[directory] ^= 1;
            bytes[spans[0].payload.start] ^= 1;
        });
        assert_eq!(copy.repaired(&format!("{name}, directory and block 0")), (1, 1, true));
    }
    println!("{mended} superblocks, directories and trailers mended without a bake");
}

#[test]
fn cut_and_missing_files_are_baked_anew() {
    for kind in ARCHIVES {
        let name = format!("{kind}.glow");
        let whole = fs::metadata(baked().job().join(&name)).unwrap().len();
        let (spans, _) = spans(kind);
        let blocks = spans.len() as u64;
        for length in [0, 1, 4096, 5000, whole / 2] {
            let copy = baked().copy();
            let file = fs::OpenOptions::new().write(true).open(copy.file(&name)).unwrap();
            file.set_len(length).unwrap();
            assert!(copy.verify().damages.iter().all(|d| d.file == name), "{name} of {length} bytes");
            let (made, files, rebaked) = copy.repaired(&format!("{name} cut to {length}"));
            let lost = spans.iter().filter(|span| span.payload.end as u64 > length).count() as u64;
            assert_eq!((made, files, rebaked), (lost, 1, true), "{name} cut to {length}");
        }
        let copy = baked().copy();
        fs::remove_file(copy.file(&name)).unwrap();
        let found = copy.verify().damages;
        assert_eq!((found[0].file.as_str(), found[0].problem.as_str()), (name.as_str(), "missing"));
        assert_eq!(copy.repaired(&format!("{name} missing")), (blocks, 1, true));
    }
}

#[test]
fn blocks_in_wrong_places_are_named() {
    let copied = baked().copy();
    let sites = spans("sites").0;
    let of = |tag: &str| sites.iter().find(|span| span.tag == tag).unwrap();
    let (a, b) = (of("albedo"), of("exitance"));
    assert_eq!(a.bytes.len(), b.bytes.len(), "they are there to be swapped");
    copied.edit("sites.glow", |bytes| {
        let (first, second) = (bytes[a.bytes.clone()].to_vec(), bytes[b.bytes.clone()].to_vec());
        bytes[a.bytes.clone()].copy_from_slice(&second);
        bytes[b.bytes.clone()].copy_from_slice(&first);
    });
    let named: Vec<_> = copied.verify().damages.iter().map(|d| d.tag.clone().unwrap()).collect();
    assert_eq!(named, ["albedo", "exitance"]);
    assert_eq!(copied.repaired("swapped blocks"), (2, 1, true));

    // The same scene seen by another lens: equally long payloads, other digest of inputs.
    copy(&baked().path("cornell"), &baked().path("twin"));
    let scene = baked().path("twin").join("scene.toml");
    let text = fs::read_to_string(&scene).unwrap();
    assert!(text.contains("fov = 39.3"), "{text}");
    fs::write(&scene, text.replace("fov = 39.3", "fov = 39.4")).unwrap();
    baked().bake("twin", "twin_job");
    for kind in ARCHIVES {
        let name = format!("{kind}.glow");
        let other = fs::read(baked().path("twin_job").join(&name)).unwrap();
        for span in spans(kind).0 {
            let copy = baked().copy();
            copy.edit(&name, |bytes| {
                bytes[span.bytes.clone()].copy_from_slice(&other[span.bytes.clone()]);
            });
            let found = copy.verify().damages;
            let places: Vec<_> = found.iter().map(|d| (d.file.as_str(), d.block)).collect();
            assert_eq!(places, [(name.as_str(), Some(span.number))], "{found:?}");
        }
        let copy = baked().copy();
        fs::write(copy.file(&name), &other).unwrap();
        let found = copy.verify().damages;
        assert!(found[0].file == name && found[0].problem.contains("of another job"), "{found:?}");
        assert!(copy.repaired(&format!("{name} of another job")).2);
    }
}

#[test]
fn notes_beside_the_archives_are_found_again_where_they_can_be() {
    for damage in [None, Some(&b"{\"a\": 1"[..]), Some(b"")] {
        let spoil = |copy: &super::Copy, name: &str| match damage {
            None => fs::remove_file(copy.file(name)).unwrap(),
            Some(text) => fs::write(copy.file(name), text).unwrap(),
        };
        let copy = baked().copy();
        spoil(&copy, "inputs.json");
        assert_eq!(copy.verify().damages[0].file, "inputs.json");
        assert_eq!(copy.repaired("inputs.json"), (0, 1, false));

        let copy = baked().copy();
        spoil(&copy, "summary.json");
        assert_eq!(copy.verify().damages[0].file, "summary.json");
        assert_eq!(copy.repaired("summary.json"), (0, 1, true));

        // Archives record them, and their digest proves it.
        let copy = baked().copy();
        spoil(&copy, "options.json");
        assert_eq!(copy.verify().damages[0].file, "options.json");
        assert_eq!(copy.repaired("options.json"), (0, 1, false));
    }
    // Options that are whole, but not those the archives were made by; the archives have the majority.
    let copy = baked().copy();
    copy.edit("options.json", |text| {
        let changed = String::from_utf8(text.clone()).unwrap().replace("0.2", "0.3");
        *text = sealed(&changed);
    });
    let found = copy.verify().damages;
    assert_eq!((found.len(), found[0].file.as_str()), (1, "options.json"), "{found:?}");
}

#[test]
fn options_that_nobody_records_are_lost() {
    let copy = baked().copy();
    for kind in ARCHIVES {
        let path = copy.file(&format!("{kind}.glow"));
        let archive = Archive::open(&path).unwrap();
        let mut writer = Writer::create(&path, archive.kind(), archive.digests()).unwrap();
        archive.all_blocks().for_each(|block| writer.append_copy(block).unwrap());
        writer.finish(&[("program", "test")]).unwrap();
    }
    fs::remove_file(copy.file("options.json")).unwrap();
    let error = repair(&copy.job(), &copy.verify(), &Silent).unwrap_err();
    assert_eq!(error.exit_code(), 9);
    assert!(error.to_string().contains("--restart"), "{error}");
}

#[test]
fn a_repair_from_other_inputs_is_refused() {
    let folder = tempfile::tempdir_in(baked().path("")).unwrap();
    let scene = folder.path().join("cornell");
    copy(&baked().path("cornell"), &scene);
    let job = folder.path().join("job");
    let options = glowtree::bake::Options { error: 0.2, preview: false, ..Default::default() };
    glowtree::bake::run(&scene.join("scene.toml"), &job, &options, &Silent).unwrap();
    let file = job.join("sites.glow");
    let mut bytes = fs::read(&file).unwrap();
    bytes[5000] ^= 1;
    fs::write(&file, &bytes).unwrap();
    let report = glowtree::bake::verify::verify(&job, &Silent).unwrap();
    let green = scene.join("green.ply");
    let text = fs::read(&green).unwrap();
    for changed in [None, Some([&text[..], b"\n"].concat())] {
        match changed {
            None => fs::remove_file(&green).unwrap(),
            Some(text) => fs::write(&green, text).unwrap(),
        }
        let error = repair(&job, &report, &Silent).unwrap_err();
        assert_eq!(error.exit_code(), 3, "{error}");
        assert!(error.to_string().contains("green.ply"), "{error}");
        assert!(fs::read(&file).unwrap() == bytes, "the job is as it was");
        assert_eq!(super::files(folder.path()), ["cornell", "job"], "no litter");
    }
}

#[test]
fn several_damages_are_all_named_and_made_anew_at_once() {
    let copy = baked().copy();
    for kind in ARCHIVES {
        copy.edit(&format!("{kind}.glow"), |bytes| {
            for span in spans(kind).0.iter().step_by(2).filter(|span| !span.payload.is_empty()) {
                bytes[span.payload.end - 1] ^= 128;
            }
        });
    }
    let wanted: usize = ARCHIVES
        .iter()
        .map(|kind| spans(kind).0.iter().step_by(2).filter(|span| !span.payload.is_empty()).count())
        .sum();
    let named = copy.verify().damages.iter().filter(|d| d.block.is_some()).count();
    assert!(named >= wanted, "{named} of {wanted}");
    let (made, files, rebaked) = copy.repaired("every other block");
    assert_eq!((made, files, rebaked), (wanted as u64, 4, true));
}

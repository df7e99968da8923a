//! Interruption: whatever operation fails, whenever the process dies or the power goes, the next run ends with the
//! bytes of an undisturbed one.

use std::path::Path;
use std::sync::Arc;

use glowtree::archive::{Archive, Digest, Digests, Writer, partial_path, verify};
use glowtree::geometry::hash::mix2;
use glowtree::{Error, Result};

use super::faults::{Fault, Memory};
use super::{KIND, aligned, digests, fill, whole};

const PATH: &str = "job/links.glow";
/// Links in the longest block: 80 kB, beyond what the writer gathers into one write.
const LONG: usize = 20_000;

/// A stage as a job runs it: nothing to do when the file is there, else begun or continued.
fn run(memory: &Memory) -> Result<()> {
    let path = Path::new(PATH);
    if memory.bytes(path).is_some() {
        return Ok(());
    }
    let (mut writer, _) = Writer::resume_in(Arc::new(memory.clone()), path, KIND, digests())?;
    writer.reserve(100_000)?;
    fill(&mut writer, LONG)?;
    writer.finish(&[("program", "test")]).map(|_| ())
}

/// Compares without printing a hundred thousand numbers.
fn assert_same(memory: &Memory, expected: &[u8], when: &str) {
    let bytes = memory.bytes(Path::new(PATH)).expect("a finished file");
    let first = bytes.iter().zip(expected).position(|(got, expected)| got != expected);
    assert!(
        bytes == expected,
        "{when}: {} bytes for {}, first difference {first:?}",
        bytes.len(),
        expected.len()
    );
}

fn operations() -> u64 {
    let memory = Memory::default();
    run(&memory).unwrap();
    memory.operations()
}

#[test]
fn a_cut_file_is_resumed_from_its_whole_blocks() {
    let expected = whole(digests(), 100);
    for length in 0..=expected.len() {
        let memory = Memory::default();
        memory.put(&partial_path(PATH), &expected[..length]);
        let (mut writer, resumed) =
            Writer::resume_in(Arc::new(memory.clone()), Path::new(PATH), KIND, digests()).unwrap();
        assert_eq!(resumed.blocks, writer.entries().len());
        let superblock = if length < 4096 { writer.bytes() } else { 0 }; // written anew when it was torn
        assert_eq!(writer.bytes() - superblock + resumed.dropped_bytes, length as u64);
        fill(&mut writer, 100).unwrap();
        writer.finish(&[("program", "test")]).unwrap();
        assert_same(&memory, &expected, &format!("cut at {length}"));
    }
}

#[test]
fn an_unfinished_file_of_another_job_is_refused() {
    let memory = Memory::default();
    memory.put(&partial_path(PATH), &whole(digests(), 100));
    let other = Digests { inputs: Digest::of_bytes(b"other"), ..digests() };
    let stale = Writer::resume_in(Arc::new(memory.clone()), Path::new(PATH), KIND, other).unwrap_err();
    assert!(
        matches!(&stale, Error::JobDiffers { difference, .. } if difference.contains("digest of inputs")
            && !difference.contains("options")),
        "{stale}"
    );
    assert!(memory.bytes(&partial_path(PATH)).unwrap() == whole(digests(), 100), "not left as it was");
}

#[test]
fn every_failing_operation_is_reported_and_survived() {
    let expected = whole(digests(), LONG);
    let mut reported = 0;
    for fault in [Fault::Failed, Fault::Full, Fault::Interrupted, Fault::Short, Fault::Killed] {
        // Beginning, and continuing a file that already holds some blocks.
        for present in [0, 7000] {
            for at in 1.. {
                let memory = Memory::with_fault(at, fault);
                if present > 0 {
                    memory.put(&partial_path(PATH), &expected[..present]);
                }
                let outcome = run(&memory);
                let last = memory.operations() < at;
                match &outcome {
                    Ok(()) => {}
                    Err(Error::DiskFull { needed_bytes, .. }) => {
                        assert!(fault == Fault::Full && *needed_bytes > 0, "{fault:?} at {at}");
                    }
                    Err(error) => assert_eq!(error.exit_code(), 8, "{fault:?} at {at}: {error}"),
                }
                if matches!(fault, Fault::Interrupted | Fault::Short) {
                    assert!(outcome.is_ok(), "{fault:?} at {at} is no failure: {outcome:?}");
                }
                reported += u32::from(outcome.is_err());
                memory.next_process();
                run(&memory).unwrap();
                assert_same(&memory, &expected, &format!("{fault:?} at {at}"));
                // And what was made durable is that, even if a sync had failed in between.
                let machine = memory.after_power_loss(512, || 0);
                run(&machine).unwrap();
                assert_same(&machine, &expected, &format!("{fault:?} at {at}, power loss"));
                if last {
                    break;
                }
            }
        }
    }
    println!("{reported} failures reported and survived");
    assert!(reported > 50);
}

/// States of the machine after losing power at every operation: the ends of two runs, and how often the file that
/// carried its name was not the one that should be there.
fn power_losses(seeds: u64, storage: impl Fn(u64) -> Memory) -> (u32, u32) {
    let expected = whole(digests(), LONG);
    let (mut states, mut wrong) = (0, 0);
    for at in 1..=operations() {
        let memory = storage(at);
        let _ = run(&memory);
        for seed in 0..seeds {
            let mut drawn = 0;
            let random = || {
                drawn += 1;
                mix2(seed * 1000 + at, drawn)
            };
            let machine = memory.after_power_loss([512, 4096][seed as usize % 2], random);
            if let Some(bytes) = machine.bytes(Path::new(PATH))
                && bytes != expected
            {
                wrong += 1;
                let bytes = aligned(&bytes);
                let opened = Archive::from_bytes(&bytes, "lost");
                assert!(opened.is_err() || !verify(&opened.unwrap()).unwrap().damaged.is_empty(), "silent");
            } else {
                run(&machine).unwrap();
                assert_same(&machine, &expected, &format!("at {at}, seed {seed}"));
            }
            states += 1;
        }
    }
    (states, wrong)
}

#[test]
fn no_power_loss_costs_more_than_the_tail() {
    let (states, wrong) = power_losses(120, |at| Memory::with_fault(at, Fault::Killed));
    println!("{states} states after a power loss, {wrong} wrong");
    assert!(states >= 2000 && wrong == 0, "{wrong} of {states}");
}

#[test]
fn a_disk_that_lies_about_syncs_is_noticed() {
    // The oracle of the test above must see what a missing sync does; and the reader must, too.
    let (states, wrong) = power_losses(20, |_| Memory::lying());
    println!("{states} states of a lying disk, {wrong} wrong and all of them detected");
    assert!(wrong > 0, "the simulation loses nothing");
}

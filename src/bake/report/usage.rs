//! Time and memory that a run takes.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::{Builder, JoinHandle, park_timeout};
use std::time::{Duration, Instant};

use cpu_time::ProcessTime;
use serde::{Deserialize, Serialize};

/// How often anonymous memory is sampled: a reading costs about 30 µs, so this is below 0.2 % of one core, and what
/// grows and shrinks again within 20 ms is at most a few hundred megabytes at memory speed.
const SAMPLE_INTERVAL: Duration = Duration::from_millis(20);

/// What a run has used so far.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Usage {
    /// Wall-clock time.
    pub seconds: f64,
    /// CPU time of all threads, user and system.
    pub cpu_seconds: f64,
    /// Largest anonymous resident memory seen (sampled); 0 where the system does not tell.
    pub peak_anonymous_bytes: u64,
    /// Largest resident memory, file-backed pages included; 0 where the system does not tell.
    pub peak_resident_bytes: u64,
}

/// Wall-clock and CPU time since a moment.
#[derive(Debug, Clone, Copy)]
pub struct Stopwatch {
    wall: Instant,
    cpu: ProcessTime,
}

impl Stopwatch {
    /// Starts now.
    pub fn start() -> Self {
        Self { wall: Instant::now(), cpu: ProcessTime::now() }
    }

    /// Wall-clock seconds since the start.
    pub fn seconds(&self) -> f64 {
        self.wall.elapsed().as_secs_f64()
    }

    /// CPU seconds of the process since the start.
    pub fn cpu_seconds(&self) -> f64 {
        self.cpu.elapsed().as_secs_f64()
    }
}

/// Measures a run from [`Meter::start`] on; samples memory from a thread of its own until dropped.
#[derive(Debug)]
pub struct Meter {
    watch: Stopwatch,
    peak_anonymous: Arc<AtomicU64>,
    stop: Arc<AtomicBool>,
    sampler: Option<JoinHandle<()>>,
}

impl Meter {
    /// Starts the clock and the sampler.
    pub fn start() -> Self {
        let peak_anonymous = Arc::new(AtomicU64::new(resident().anonymous_bytes));
        let stop = Arc::new(AtomicBool::new(false));
        let (peak, stopped) = (Arc::clone(&peak_anonymous), Arc::clone(&stop));
        let sampler = Builder::new().spawn(move || {
            while !stopped.load(Ordering::Relaxed) {
                peak.fetch_max(resident().anonymous_bytes, Ordering::Relaxed);
                park_timeout(SAMPLE_INTERVAL);
            }
        });
        // Without memory for a thread, whoever asks samples.
        Self { watch: Stopwatch::start(), peak_anonymous, stop, sampler: sampler.ok() }
    }

    /// What has been used since the start; resident memory is the process's peak.
    pub fn usage(&self) -> Usage {
        let now = resident();
        let sampled = self.peak_anonymous.fetch_max(now.anonymous_bytes, Ordering::Relaxed);
        Usage {
            seconds: self.watch.seconds(),
            cpu_seconds: self.watch.cpu_seconds(),
            peak_anonymous_bytes: sampled.max(now.anonymous_bytes),
            peak_resident_bytes: now.peak_bytes,
        }
    }
}

impl Meter {
    /// Largest anonymous resident memory seen so far; cheap enough for every block.
    pub fn peak_anonymous_bytes(&self) -> u64 {
        if self.sampler.is_none() {
            self.peak_anonymous.fetch_max(resident().anonymous_bytes, Ordering::Relaxed);
        }
        self.peak_anonymous.load(Ordering::Relaxed)
    }
}

impl Drop for Meter {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(sampler) = self.sampler.take() {
            sampler.thread().unpark();
            // The sampler neither panics nor holds anything; a failed join would change nothing here.
            let _ = sampler.join();
        }
    }
}

/// The process's memory now.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Resident {
    /// Anonymous pages resident (RssAnon).
    pub anonymous_bytes: u64,
    /// All pages resident (VmRSS).
    pub bytes: u64,
    /// The most that ever was resident (VmHWM).
    pub peak_bytes: u64,
}

/// Reads the process's memory from `/proc/self/status`; zeros where there is no such file.
pub fn resident() -> Resident {
    std::fs::read_to_string("/proc/self/status").map(|text| parse(&text)).unwrap_or_default()
}

/// Picks the three figures, given in kB, from the text of a status file.
fn parse(status: &str) -> Resident {
    let field = |name: &str| {
        let line = status.lines().find_map(|line| line.strip_prefix(name));
        let kilobytes = line.and_then(|rest| rest.trim_start_matches(':').split_whitespace().next());
        kilobytes.and_then(|text| text.parse::<u64>().ok()).unwrap_or(0) * 1024
    };
    Resident { anonymous_bytes: field("RssAnon"), bytes: field("VmRSS"), peak_bytes: field("VmHWM") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn status_fields_are_found_and_absent_ones_are_zero() {
        let text = "Name:\tx\nVmHWM:\t   2048 kB\nVmRSS:\t1024 kB\n";
        assert_eq!(parse(text), Resident { anonymous_bytes: 0, bytes: 1 << 20, peak_bytes: 2 << 20 });
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn meter_sees_a_block_that_lived_for_a_while() {
        let before = resident().anonymous_bytes;
        let meter = Meter::start();
        let block = vec![1u8; 64 << 20];
        std::thread::sleep(5 * SAMPLE_INTERVAL);
        assert!(std::hint::black_box(&block)[4096] == 1);
        drop(block);
        let usage = meter.usage();
        // Other tests of this process may free memory meanwhile, never 32 MiB of it.
        assert!(usage.peak_anonymous_bytes >= before + (32 << 20), "{usage:?}, before {before}");
        assert!(usage.seconds >= 0.1 && usage.peak_resident_bytes >= usage.peak_anonymous_bytes / 2);
    }
}

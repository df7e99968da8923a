//! What a row counts.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

/// Trials under way at once: a trial waits for the disk half of its time.
const WORKERS: usize = 3;
/// Failures that are printed; the rest is counted.
const SHOWN: usize = 10;

/// The counts of a row, shared by its trials.
#[derive(Debug)]
pub struct Tally {
    asked: AtomicU64,
    done: AtomicU64,
    wrong: AtomicU64,
    lost: AtomicU64,
    broken: AtomicU64,
    remarks: Mutex<Vec<String>>,
    failures: Mutex<Vec<String>>,
}

/// How a trial ended badly.
#[derive(Debug)]
pub enum Bad {
    /// A result that differs and nobody said so.
    Wrong(String),
    /// So many finished blocks were lost or made again.
    Lost(u64, String),
    /// Another promise: an exit code, a time, a message.
    Broken(String),
}

/// A trial's end.
pub type Trial = Result<(), Bad>;

/// A promise that was not kept.
pub fn broken<T>(why: impl Into<String>) -> Result<T, Bad> {
    Err(Bad::Broken(why.into()))
}

impl Tally {
    /// For a row that was asked for so many trials.
    pub fn new(asked: u64) -> Self {
        let zero = || AtomicU64::new(0);
        let (remarks, failures) = (Mutex::default(), Mutex::default());
        let (done, wrong, lost, broken) = (zero(), zero(), zero(), zero());
        Self { asked: AtomicU64::new(asked), done, wrong, lost, broken, remarks, failures }
    }

    /// Trials asked for.
    pub fn asked(&self) -> u64 {
        self.asked.load(Ordering::Relaxed)
    }

    /// There are only so many different ones; the lesser count is what is asked from now on.
    pub fn at_most(&self, all: u64) -> u64 {
        self.asked.fetch_min(all, Ordering::Relaxed).min(all)
    }

    /// One trial of those asked for.
    pub fn trial(&self, name: &str, run: impl FnOnce() -> Trial) {
        self.check(name, run);
        self.count(1);
    }

    /// What is looked at on the way; a panic in it is a broken promise.
    pub fn check(&self, name: &str, run: impl FnOnce() -> Trial) {
        let outcome = catch_unwind(AssertUnwindSafe(run));
        match outcome.unwrap_or_else(|_| broken("panicked")) {
            Ok(()) => {}
            Err(Bad::Wrong(why)) => self.fail(&self.wrong, 1, format!("{name}: wrong: {why}")),
            Err(Bad::Lost(blocks, why)) => {
                self.fail(&self.lost, blocks.max(1), format!("{name}: lost: {why}"));
            }
            Err(Bad::Broken(why)) => self.fail(&self.broken, 1, format!("{name}: {why}")),
        }
    }

    /// Trials 0 to `count`, some at once.
    pub fn trials(&self, count: u64, run: impl Fn(u64) -> (String, Trial) + Sync) {
        let next = AtomicU64::new(0);
        let work = || {
            loop {
                let number = next.fetch_add(1, Ordering::Relaxed);
                if number >= count {
                    return;
                }
                let mut name = format!("trial {number}");
                let outcome = catch_unwind(AssertUnwindSafe(|| run(number)));
                let trial = match outcome {
                    Ok((called, trial)) => {
                        name = called;
                        trial
                    }
                    Err(_) => broken("panicked"),
                };
                self.trial(&name, || trial);
            }
        };
        std::thread::scope(|scope| (0..WORKERS).for_each(|_| drop(scope.spawn(work))));
    }

    /// More trials that a row got done by other means.
    pub fn count(&self, trials: u64) {
        self.done.fetch_add(trials, Ordering::Relaxed);
    }

    /// A line that is printed below the row's.
    pub fn remark(&self, text: impl Into<String>) {
        self.remarks.lock().unwrap().push(text.into());
    }

    fn fail(&self, counter: &AtomicU64, by: u64, text: String) {
        counter.fetch_add(by, Ordering::Relaxed);
        self.failures.lock().unwrap().push(text);
    }

    /// Whether all was done and nothing was bad.
    pub fn holds(&self) -> bool {
        let none = |counter: &AtomicU64| counter.load(Ordering::Relaxed) == 0;
        let done = self.done.load(Ordering::Relaxed) >= self.asked();
        done && none(&self.wrong) && none(&self.lost) && none(&self.broken)
    }

    /// Asked, done, silent wrong results, blocks lost or redone, other promises broken.
    pub fn counts(&self) -> String {
        let [done, wrong, lost, broken] =
            [&self.done, &self.wrong, &self.lost, &self.broken].map(|c| c.load(Ordering::Relaxed));
        format!("{:6}  {done:6}  {wrong:6}  {lost:6}  {broken:6}", self.asked())
    }

    /// The remarks and the first failures.
    pub fn print_remarks(&self) {
        self.remarks.lock().unwrap().iter().for_each(|remark| println!("     · {remark}"));
        let failures = self.failures.lock().unwrap();
        failures.iter().take(SHOWN).for_each(|failure| println!("     ! {failure}"));
        if failures.len() > SHOWN {
            println!("     ! and {} more", failures.len() - SHOWN);
        }
    }
}

/// Evenly spread picks of `count` among `all`, from 1; all of them when there are not more.
pub fn spread(count: u64, all: u64) -> Vec<u64> {
    let count = count.min(all);
    (0..count).map(|n| 1 + (u128::from(n) * u128::from(all) / u128::from(count)) as u64).collect()
}

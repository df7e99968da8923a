//! Where edits wait for the one who solves: one at most, the newest.

use std::sync::mpsc::{self, Receiver, Sender};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

use super::edit::Edit;

/// What became of an edit.
#[derive(Debug, Clone, PartialEq)]
pub enum Outcome {
    /// The answer's bytes.
    Done(Vec<u8>),
    /// A newer one came.
    Superseded,
    /// It has no meaning, for this reason.
    Refused(String),
    /// It could not be solved, for this reason.
    Failed(String),
}

/// An edit and who asked.
#[derive(Debug)]
pub struct Order {
    /// What is asked.
    pub edit: Edit,
    asker: Sender<Outcome>,
}

impl Order {
    /// Answers; who asked may be gone.
    pub fn answer(self, outcome: Outcome) {
        let _ = self.asker.send(outcome);
    }
}

/// The newest edit that nobody has begun with.
#[derive(Debug, Default)]
pub struct Desk {
    waiting: Mutex<Option<Order>>,
    came: Condvar,
}

impl Desk {
    /// Lays an edit down; one that waited is superseded. The outcome comes through the channel, which closes without one when
    /// nobody solves any more.
    pub fn ask(&self, edit: Edit) -> Receiver<Outcome> {
        let (asker, outcome) = mpsc::channel();
        if let Some(older) = self.waiting().replace(Order { edit, asker }) {
            older.answer(Outcome::Superseded);
        }
        self.came.notify_one();
        outcome
    }

    /// Waits for an edit.
    pub fn next(&self) -> Order {
        let mut waiting = self.waiting();
        loop {
            match waiting.take() {
                Some(order) => return order,
                None => waiting = self.came.wait(waiting).unwrap_or_else(PoisonError::into_inner),
            }
        }
    }

    /// Whether an edit waits.
    pub fn has_newer(&self) -> bool {
        self.waiting().is_some()
    }

    fn waiting(&self) -> MutexGuard<'_, Option<Order>> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_edit_is_next_and_older_ones_are_told() {
        let desk = Desk::default();
        let edit = |degrees| Edit { rotate: Some(degrees), ..Edit::default() };
        let (first, second) = (desk.ask(edit(1.0)), desk.ask(edit(2.0)));
        assert_eq!(first.recv(), Ok(Outcome::Superseded));
        let order = desk.next();
        assert!(order.edit == edit(2.0) && !desk.has_newer());
        order.answer(Outcome::Done(vec![7]));
        assert_eq!(second.recv(), Ok(Outcome::Done(vec![7])));
    }
}

//! `--max-memory`: what the bake may use, and the moment it is seen to use more.

use crate::bake::report::usage::Meter;
use crate::error::{Error, Result};

/// Anonymous memory that a bake may use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Budget {
    limit_bytes: Option<u64>,
}

impl Budget {
    /// Of so many bytes; None is no limit.
    pub fn new(limit_bytes: Option<u64>) -> Self {
        Self { limit_bytes }
    }

    /// Errors when more than the budget has been in use at any moment that was seen: asked between blocks, so that a run
    /// that ends well has kept to it.
    ///
    /// # Errors
    /// [`Error::Memory`].
    pub fn check(&self, meter: &Meter) -> Result<()> {
        self.refuse_above("the bake", meter.peak_anonymous_bytes())
    }

    /// Errors when a stage would need more, on top of what is in use now.
    ///
    /// # Errors
    /// [`Error::Memory`].
    pub fn ask(&self, stage: &str, more_bytes: u64) -> Result<()> {
        match self.limit_bytes {
            None => Ok(()),
            Some(_) => {
                let now = crate::bake::usage::resident().anonymous_bytes;
                self.refuse_above(stage, now.saturating_add(more_bytes))
            }
        }
    }

    /// Errors when so many bytes are more than the budget.
    ///
    /// # Errors
    /// [`Error::Memory`].
    pub fn refuse_above(&self, stage: &str, needed_bytes: u64) -> Result<()> {
        match self.limit_bytes {
            Some(budget_bytes) if needed_bytes > budget_bytes => {
                Err(Error::Memory { stage: stage.into(), needed_bytes, budget_bytes })
            }
            _ => Ok(()),
        }
    }
}

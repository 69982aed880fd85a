//! The check of near and far of a network whose output kind was guessed.

use crate::prior::OpenPrior;

/// A warning where a network's near and far come out swapped in rooms of known depth. Only one whose output kind was guessed from a
/// flag or the file name is tested, once.
#[cfg(feature = "program")]
pub(super) fn swapped<'p>(open: &'p OpenPrior<'_>) -> Option<&'p str> {
    let found = open.order.get_or_init(|| {
        // What can't be predicted fails in the run too, with its own error.
        let tried =
            open.origin().is_doubtful().then(|| mde_eval::order_check::OrderCheck::swapped(open.prior()));
        let trial = tried?.ok()??;
        Some(open.origin().swapped(trial.mean()))
    });
    found.as_deref()
}

/// Without procedural rooms there is nothing to test with.
#[cfg(not(feature = "program"))]
pub(super) fn swapped<'p>(open: &'p OpenPrior<'_>) -> Option<&'p str> {
    open.order.get().and_then(Option::as_deref)
}

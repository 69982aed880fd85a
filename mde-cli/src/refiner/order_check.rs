//! The check of near and far of a network whose output kind was guessed.

use crate::prior::OpenPrior;

/// A warning where a network's near and far come out swapped in rooms of known depth. Only one whose output kind was guessed from a
/// flag or the file name is tested, once. Without procedural rooms there is nothing to test with.
pub(super) fn swapped<'p>(open: &'p OpenPrior<'_>) -> Option<&'p str> {
    #[cfg(feature = "program")]
    {
        let origin = open.origin();
        let is_guessed = origin.form == crate::prior::origin::PriorForm::Network && !origin.kind_is_told;
        if is_guessed && open.order.get().is_none() {
            // Not within `get_or_init`: a thread of rayon's pool could meanwhile take up work that waits for it.
            // What can't be predicted fails in the run too, with its own error.
            let trial = mde_eval::order_check::OrderCheck::swapped(open.prior()).ok().flatten();
            // Another thread finds the same.
            let _ = open.order.set(trial.map(|trial| origin.swapped(trial.mean())));
        }
    }
    open.order.get()?.as_deref()
}

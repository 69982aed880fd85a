use crate::frustum::Frustum;
use crate::network::Network;

/// A fitted network and its volume.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Fitted {
    pub(crate) network: Network<f32>,
    pub(crate) frustum: Frustum,
}

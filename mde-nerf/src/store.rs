//! A fitted field as a safetensors file: the parameters as tensors, the rest as JSON in the header.

use crate::config::NerfConfig;
use crate::frustum::Frustum;
use crate::nerf::Fitted;
use crate::network::Network;
use crate::{Error, Result};
use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensors};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::path::Path;

/// Incremented whenever the meaning of the tensors or of the header changes.
const VERSION: u32 = 5;
const HEADER: &str = "mde-nerf";

#[derive(Serialize, Deserialize)]
struct Header {
    version: u32,
    config: NerfConfig,
    /// Of [`SamplingConfig`](crate::SamplingConfig), in which a configuration file has not got them.
    near: Option<f64>,
    far: Option<f64>,
    seed: u64,
    frustum: Frustum,
}

/// CRC-32 of the header's text and the tensors' bytes in their order in the file, hexadecimal; it stands before the text.
fn checksum(header: &str, [table, network]: [&[u8]; 2]) -> String {
    format!("{:08x}", crc32fast::hash(&[header.as_bytes(), network, table].concat()))
}

#[derive(Deserialize)]
struct Version {
    version: u32,
}

/// The bytes of the file.
pub(crate) fn encode(config: &NerfConfig, seed: u64, fitted: &Fitted) -> Result<Vec<u8>> {
    let bytes = |numbers: &[f32]| numbers.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let table = fitted.network.grid().map_or_else(Vec::new, |grid| bytes(&grid.table));
    let network = bytes(&fitted.network.mlp.parameters);
    let header = Header {
        version: VERSION,
        config: config.clone(),
        near: config.sampling.near,
        far: config.sampling.far,
        seed,
        frustum: fitted.frustum.clone(),
    };
    let header = serde_json::to_string(&header).map_err(external)?;
    let header = format!("{} {header}", checksum(&header, [&table, &network]));
    let tensor = |bytes| TensorView::new(Dtype::F32, vec![<[u8]>::len(bytes) / 4], bytes).map_err(external);
    let tensors = [("table", tensor(&table)?), ("network", tensor(&network)?)];
    safetensors::serialize(tensors, Some(HashMap::from([(HEADER.to_owned(), header)]))).map_err(external)
}

fn external(error: impl std::error::Error + Send + Sync + 'static) -> Error {
    Error::External(Box::new(error))
}

pub(crate) fn load(path: &Path) -> Result<(NerfConfig, u64, Fitted)> {
    let format = |reason: String| Error::Format { path: path.to_owned(), reason };
    let file = std::fs::read(path).map_err(|source| Error::Io { path: path.to_owned(), source })?;
    let (_, metadata) = SafeTensors::read_metadata(&file).map_err(|e| format(foreign(e)))?;
    let missing = || format(format!("its header has no {HEADER:?} entry; give a file written by mde-nerf"));
    let entry = metadata.metadata().as_ref().and_then(|entries| entries.get(HEADER)).ok_or_else(missing)?;
    let (sum, header) = entry.split_once(' ').unwrap_or(("", entry));
    // The version first: the header of another version need not parse.
    let Version { version } = serde_json::from_str(header).map_err(|e| format(foreign(e)))?;
    if version != VERSION {
        return Err(format(format!("its version is {version}, not {VERSION}; fit the field again")));
    }
    let tensors = SafeTensors::deserialize(&file).map_err(|e| format(foreign(e)))?;
    let data = |name: &str| match tensors.tensor(name) {
        Ok(tensor) if tensor.dtype() == Dtype::F32 => Ok(tensor.data()),
        Ok(_) => Err(format(format!("its tensor {name:?} is not of 32-bit floats"))),
        Err(e) => Err(format(foreign(e))),
    };
    let parts = [data("table")?, data("network")?];
    if sum != checksum(header, parts) {
        return Err(format("its checksum is wrong, the file is damaged; fit the field again".into()));
    }
    let mut header: Header = serde_json::from_str(header).map_err(|e| format(foreign(e)))?;
    (header.config.sampling.near, header.config.sampling.far) = (header.near, header.far);
    header.config.validate().map_err(|e| format(e.to_string()))?;
    if let Some(fault) = header.frustum.fault() {
        return Err(format(format!("{fault}; fit the field again")));
    }
    let numbers = |bytes: &[u8]| bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
    let [table, network]: [Vec<f32>; 2] = parts.map(numbers);
    if !table.iter().chain(&network).all(|x| x.is_finite()) {
        return Err(format("its parameters are not finite; fit the field again".into()));
    }
    let network = Network::from_parameters(&header.config.field, table, network)
        .ok_or_else(|| format("its tensors do not fit its configuration".into()))?;
    Ok((header.config, header.seed, Fitted { network, frustum: header.frustum }))
}

/// The fault of a file that is cut, or of another program.
fn foreign(fault: impl std::fmt::Display) -> String {
    format!("{fault}; give a file written by mde-nerf")
}

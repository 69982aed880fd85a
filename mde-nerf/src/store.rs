//! A fitted field as a safetensors file: the parameters as tensors, the rest as JSON in the header.

use crate::config::{NerfConfig, SamplingConfig, VolumeConfig};
use crate::frustum::Frustum;
use crate::nerf::Fitted;
use crate::network::{Encoding, Network};
use crate::{Error, Result};
use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensors};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::io::Write;
use std::path::Path;

/// Incremented whenever the meaning of the tensors or of the header changes.
const VERSION: u32 = 4;
const HEADER: &str = "mde-nerf";

#[derive(Serialize, Deserialize)]
struct Header {
    version: u32,
    config: NerfConfig,
    hidden: Hidden,
    seed: u64,
    frustum: Frustum,
    /// CRC-32 of the tensors' bytes: table, network.
    checksum: u32,
    /// CRC-32 of the header's text with eight zeros here, hexadecimal.
    header_checksum: String,
}

/// The settings of [`SamplingConfig`](crate::SamplingConfig) that a configuration file has not.
#[derive(Serialize, Deserialize)]
struct Hidden {
    margin: Option<f64>,
    near: Option<f64>,
    far: Option<f64>,
}

impl Hidden {
    fn of(config: &NerfConfig) -> Self {
        let SamplingConfig { volume, near, far, .. } = config.sampling;
        let margin = match volume {
            VolumeConfig::Hull => None,
            VolumeConfig::Reference { margin } => Some(margin),
        };
        Self { margin, near, far }
    }

    fn restore(self, config: &mut NerfConfig) {
        let sampling = &mut config.sampling;
        (sampling.near, sampling.far) = (self.near, self.far);
        if let (VolumeConfig::Reference { margin }, Some(stored)) = (&mut sampling.volume, self.margin) {
            *margin = stored;
        }
    }
}

/// The field of the header's own checksum, as text.
const OWN: &str = "\"header_checksum\":\"";
/// Its place holder.
const ZEROS: &str = "00000000";

/// The header's checksum as it is stated, and as it is.
fn own_checksum(header: &str) -> Option<(&str, String)> {
    let begin = header.rfind(OWN)? + OWN.len();
    let stated = header.get(begin..begin + ZEROS.len())?;
    let blank = [&header[..begin], ZEROS, header.get(begin + ZEROS.len()..)?].concat();
    Some((stated, format!("{:08x}", crc32fast::hash(blank.as_bytes()))))
}

#[derive(Deserialize)]
struct Version {
    version: u32,
}

pub(crate) fn save(path: &Path, config: &NerfConfig, seed: u64, fitted: &Fitted) -> Result<()> {
    let io = |source: std::io::Error| Error::Io { path: path.to_owned(), source };
    let file = encode(config, seed, fitted).map_err(io)?;
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut temporary = builder().tempfile_in(folder).map_err(io)?;
    temporary.write_all(&file).map_err(io)?;
    temporary.as_file().sync_all().map_err(io)?;
    temporary.persist(path).map_err(|e| io(e.error))?;
    Ok(())
}

/// The bytes of the file.
pub(crate) fn encode(config: &NerfConfig, seed: u64, fitted: &Fitted) -> std::io::Result<Vec<u8>> {
    let table = match &fitted.network.encoding {
        Encoding::Hash(grid) => grid.table.as_slice(),
        Encoding::Frequency(_) => &[],
    };
    let parts = [("table", table), ("network", &fitted.network.mlp.parameters)];
    let bytes: Vec<(&str, Vec<u8>)> =
        parts.iter().map(|(name, p)| (*name, p.iter().flat_map(|x| x.to_le_bytes()).collect())).collect();
    let header = Header {
        version: VERSION,
        config: config.clone(),
        hidden: Hidden::of(config),
        seed,
        frustum: fitted.frustum.clone(),
        checksum: checksum(bytes.iter().map(|(_, b)| b.as_slice())),
        header_checksum: ZEROS.to_owned(),
    };
    let mut header = serde_json::to_string(&header)?;
    if let Some((zeros, own)) = own_checksum(&header) {
        header = header.replace(&format!("{OWN}{zeros}"), &format!("{OWN}{own}"));
    }
    let mut tensors = Vec::new();
    for (name, bytes) in &bytes {
        let view =
            TensorView::new(Dtype::F32, vec![bytes.len() / 4], bytes).map_err(std::io::Error::other)?;
        tensors.push((*name, view));
    }
    safetensors::serialize(tensors, Some(HashMap::from([(HEADER.to_owned(), header)])))
        .map_err(std::io::Error::other)
}

/// The prefix marks what a killed run leaves. Temporary files are private by default; the result gets the permissions of the user's umask.
fn builder() -> tempfile::Builder<'static, 'static> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".mde-");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder
}

pub(crate) fn load(path: &Path) -> Result<(NerfConfig, u64, Fitted)> {
    let format = |reason: String| Error::Format { path: path.to_owned(), reason };
    let file = std::fs::read(path).map_err(|source| Error::Io { path: path.to_owned(), source })?;
    let (_, metadata) = SafeTensors::read_metadata(&file).map_err(|e| format(foreign(e)))?;
    let header = metadata.metadata().as_ref().and_then(|m| m.get(HEADER)).ok_or_else(|| {
        format(format!("its header has no {HEADER:?} entry; give a file written by mde-nerf"))
    })?;
    // The version first: the header of another version need not parse.
    let Version { version } = serde_json::from_str(header).map_err(|e| format(foreign(e)))?;
    if version != VERSION {
        return Err(format(format!("its version is {version}, not {VERSION}; fit the field again")));
    }
    if own_checksum(header).is_some_and(|(stated, own)| stated != own) {
        return Err(format(
            "the checksum of its header is wrong, the file is damaged; fit the field again".into(),
        ));
    }
    let mut header: Header = serde_json::from_str(header).map_err(|e| format(foreign(e)))?;
    header.hidden.restore(&mut header.config);
    header.config.validate().map_err(|e| format(e.to_string()))?;
    if let Some(fault) = header.frustum.fault() {
        return Err(format(format!("{fault}; fit the field again")));
    }
    let tensors = SafeTensors::deserialize(&file).map_err(|e| format(foreign(e)))?;
    let mut parts = Vec::new();
    for name in ["table", "network"] {
        let tensor = tensors.tensor(name).map_err(|e| format(foreign(e)))?;
        if tensor.dtype() != Dtype::F32 {
            return Err(format(format!("its tensor {name:?} is not of 32-bit floats")));
        }
        parts.push(tensor.data());
    }
    if checksum(parts.iter().copied()) != header.checksum {
        return Err(format("its checksum is wrong, the file is damaged; fit the field again".into()));
    }
    let finite = |bytes: &&[u8]| bytes.as_chunks::<4>().0.iter().all(|b| f32::from_le_bytes(*b).is_finite());
    if !parts.iter().all(finite) {
        return Err(format("its parameters are not finite; fit the field again".into()));
    }
    let mut numbers = parts
        .iter()
        .map(|bytes| bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect::<Vec<f32>>());
    let mut next = || numbers.next().unwrap_or_default();
    let network = Network::from_parameters(&header.config.field, next(), next())
        .ok_or_else(|| format("its tensors do not fit its configuration".into()))?;
    Ok((header.config, header.seed, Fitted { network, frustum: header.frustum }))
}

/// The fault of a file that is cut, or of another program.
fn foreign(fault: impl std::fmt::Display) -> String {
    format!("{fault}; give a file written by mde-nerf")
}

fn checksum<'b>(parts: impl Iterator<Item = &'b [u8]>) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    parts.for_each(|part| hasher.update(part));
    hasher.finalize()
}

//! Whether a JPEG is whole. Decoders fill what is missing with grey, without an error.
//!
//! The entropy-coded data of every scan is read as in ITU-T T.81, annexes F and G, without the transform.

/// Most leftover data of a whole scan, as a share of its bytes; some cameras pad.
const MOST_LEFT: f64 = 0.05;
/// Leftover bytes that no scan is refused for.
const FEW: usize = 16;
/// Bits missing at the end of a scan that no image is refused for.
const MISSING_BITS: u32 = 16;
/// Most scans that are read; decoders refuse more.
const MOST_SCANS: usize = 100;

/// What is wrong with the data of a JPEG.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Fault {
    Truncated,
    Damaged,
}

/// Finds out whether the scans of a JPEG hold every block. Kinds that the decoder refuses pass: arithmetic coding, no
/// tables, a height that follows the data.
pub(super) fn check(bytes: &[u8]) -> Result<(), Fault> {
    let mut image = Image::default();
    let mut rest = bytes.get(2..).unwrap_or_default();
    let (mut frames, mut scans) = (0, 0);
    loop {
        rest = match rest {
            [0xff, 0xd9, ..] => return image.covered(),
            // Fill bytes, and markers without content.
            [0xff, 0xff, ..] => &rest[1..],
            [0xff, 0x01 | 0xd0..=0xd8, ..] => &rest[2..],
            [0xff, kind, high, low, ..] => {
                let length = usize::from(u16::from_be_bytes([*high, *low]));
                let Some((segment, after)) =
                    rest.get(4..).and_then(|r| r.split_at_checked(length.max(2) - 2))
                else {
                    return Err(Fault::Truncated);
                };
                match kind {
                    0xc4 => image.tables(segment),
                    0xc0..=0xc2 => {
                        frames += 1;
                        // The caller has checked the size of the first one alone.
                        if frames > 1 {
                            return Err(Fault::Damaged);
                        }
                        image.frame = Frame::parse(segment, *kind == 0xc2);
                    }
                    0xdd => image.interval = word(segment, 0),
                    _ => {}
                }
                match (*kind, &mut image.frame) {
                    (0xda, Some(_)) => {
                        scans += 1;
                        match image.scan(segment, after)? {
                            Some(left) if scans <= MOST_SCANS => left,
                            _ => return Ok(()),
                        }
                    }
                    (0xda, None) => return Ok(()),
                    _ => after,
                }
            }
            _ => return Err(Fault::Truncated),
        };
    }
}

fn word(bytes: &[u8], at: usize) -> usize {
    bytes.get(at..at + 2).map_or(0, |pair| usize::from(u16::from_be_bytes([pair[0], pair[1]])))
}

#[derive(Default)]
struct Image {
    frame: Option<Frame>,
    /// Of DC and AC coefficients.
    codes: [[Option<Code>; 4]; 2],
    /// Units between two restart markers; 0 without.
    interval: usize,
}

struct Frame {
    progressive: bool,
    size: [usize; 2],
    /// The largest sampling factors.
    most: [usize; 2],
    components: Vec<Component>,
}

struct Component {
    id: u8,
    /// Horizontally and vertically.
    sampling: [usize; 2],
    /// Blocks per row of the padded grid.
    stride: usize,
    /// The coefficients that are not 0, one bit each, of a progressive image.
    nonzero: Vec<u64>,
    covered: bool,
}

impl Frame {
    fn parse(segment: &[u8], progressive: bool) -> Option<Self> {
        let size = [word(segment, 3), word(segment, 1)];
        let parts = segment.get(6..)?.chunks_exact(3).take(usize::from(*segment.get(5)?));
        let parts: Vec<(u8, [usize; 2])> =
            parts.map(|part| (part[0], [usize::from(part[1] >> 4), usize::from(part[1] & 15)])).collect();
        let most = [0, 1].map(|axis| parts.iter().map(|(_, sampling)| sampling[axis]).max().unwrap_or(0));
        let valid = parts.iter().all(|(_, sampling)| sampling.iter().all(|side| (1..=4).contains(side)));
        // A progressive image has at most four (T.81, table B.2), a sequential one no memory per block.
        let many = progressive && parts.len() > 4;
        if size.contains(&0) || parts.is_empty() || many || !valid {
            return None;
        }
        let units = [0, 1].map(|axis| size[axis].div_ceil(8 * most[axis]));
        let component = |(id, sampling): (u8, [usize; 2])| {
            let [width, height] = [0, 1].map(|axis| units[axis] * sampling[axis]);
            let nonzero = if progressive { vec![0; width * height] } else { Vec::new() };
            Component { id, sampling, stride: width, nonzero, covered: false }
        };
        let components = parts.into_iter().map(component).collect();
        Some(Self { progressive, size, most, components })
    }
}

/// A Huffman code: length and symbol for each sixteen bits, length 0 where no code begins so.
struct Code(Vec<[u8; 2]>);

impl Code {
    fn new(counts: &[u8], symbols: &[u8]) -> Self {
        let mut table = Vec::with_capacity(1 << 16);
        let lengths = counts.iter().zip(1_u8..).flat_map(|(&count, length)| (0..count).map(move |_| length));
        for (length, &symbol) in lengths.zip(symbols) {
            table.extend(std::iter::repeat_n([length, symbol], 1 << (16 - length)));
        }
        table.resize(1 << 16, [0, 0]);
        Self(table)
    }
}

impl Image {
    fn tables(&mut self, mut segment: &[u8]) {
        while let Some((&[class, ref counts @ ..], rest)) = segment.split_first_chunk::<17>() {
            let symbols: usize = counts.iter().map(|&count| usize::from(count)).sum();
            let Some((symbols, after)) = rest.split_at_checked(symbols) else { return };
            let place = self.codes.get_mut(usize::from(class >> 4));
            if let Some(place) = place.and_then(|of| of.get_mut(usize::from(class & 15))) {
                *place = Some(Code::new(counts, symbols));
            }
            segment = after;
        }
    }

    /// Every component was in a scan.
    fn covered(&self) -> Result<(), Fault> {
        let covered = |frame: &Frame| frame.components.iter().all(|component| component.covered);
        if self.frame.as_ref().is_none_or(covered) { Ok(()) } else { Err(Fault::Truncated) }
    }

    /// Reads a scan; what follows it, or nothing where it cannot be read.
    fn scan<'b>(&mut self, header: &[u8], data: &'b [u8]) -> Result<Option<&'b [u8]>, Fault> {
        let Self { frame: Some(frame), codes, interval } = self else { return Ok(None) };
        let count = usize::from(header.first().copied().unwrap_or(0));
        let Some([first, last, approximation]) =
            header.get(1 + 2 * count..).and_then(|rest| rest.first_chunk::<3>())
        else {
            return Ok(None);
        };
        let band = Band {
            progressive: frame.progressive,
            first: u32::from(*first),
            last: u32::from(*last).min(63),
            refined: approximation >> 4 != 0,
        };
        let mut parts = Vec::new();
        for named in header[1..1 + 2 * count].chunks_exact(2) {
            let Some(index) = frame.components.iter().position(|component| component.id == named[0]) else {
                return Ok(None);
            };
            let code = |class: usize, number: u8| codes[class].get(usize::from(number))?.as_ref();
            let own = [code(0, named[1] >> 4), code(1, named[1] & 15)];
            let needed = band.needs();
            if (0..2).any(|class| needed[class] && own[class].is_none()) {
                return Ok(None);
            }
            parts.push((index, own));
        }
        let mut reader = Scan { bits: Bits::new(data), band, run: 0, units: 0, interval: *interval, left: 0 };
        match parts.as_slice() {
            [] => return Ok(None),
            // Alone, a component has no padding to whole units.
            &[(index, own)] => {
                let component = &mut frame.components[index];
                let [width, height] = [0, 1].map(|axis| {
                    (frame.size[axis] * component.sampling[axis]).div_ceil(frame.most[axis]).div_ceil(8)
                });
                for row in 0..height {
                    for column in 0..width {
                        reader.next_unit()?;
                        reader.block(own, component.nonzero.get_mut(row * component.stride + column))?;
                    }
                }
            }
            several => {
                let [width, height] = [0, 1].map(|axis| frame.size[axis].div_ceil(8 * frame.most[axis]));
                for row in 0..height {
                    for column in 0..width {
                        reader.next_unit()?;
                        for &(index, own) in several {
                            let component = &mut frame.components[index];
                            let [across, down] = component.sampling;
                            for place in 0..across * down {
                                let at = (row * down + place / across) * component.stride
                                    + column * across
                                    + place % across;
                                reader.block(own, component.nonzero.get_mut(at))?;
                            }
                        }
                    }
                }
            }
        }
        for (index, _) in parts {
            frame.components[index].covered |= band.first == 0;
        }
        reader.end(data).map(Some)
    }
}

/// The coefficients of a scan.
#[derive(Clone, Copy)]
struct Band {
    progressive: bool,
    first: u32,
    last: u32,
    /// Whether the scan adds a bit to coefficients of earlier scans.
    refined: bool,
}

impl Band {
    /// Whether codes of DC and AC are needed.
    fn needs(&self) -> [bool; 2] {
        match (self.progressive, self.first) {
            (false, _) => [true, true],
            (true, 0) => [!self.refined, false],
            (true, _) => [false, true],
        }
    }
}

struct Scan<'b> {
    bits: Bits<'b>,
    band: Band,
    /// Blocks that remain without further coefficients.
    run: u32,
    units: usize,
    interval: usize,
    /// Bytes that no block needed.
    left: usize,
}

impl<'b> Scan<'b> {
    fn next_unit(&mut self) -> Result<(), Fault> {
        if self.interval > 0 && self.units == self.interval {
            self.left += self.bits.align();
            if !matches!(self.bits.rest(), [0xff, 0xd0..=0xd7, ..]) {
                return Err(Fault::Truncated);
            }
            self.bits = Bits::new(&self.bits.rest()[2..]);
            (self.units, self.run) = (0, 0);
        }
        self.units += 1;
        if self.bits.overdrawn() { Err(Fault::Truncated) } else { Ok(()) }
    }

    fn block(&mut self, codes: [Option<&Code>; 2], nonzero: Option<&mut u64>) -> Result<(), Fault> {
        let [dc, ac] = codes;
        if !self.band.progressive {
            let length = self.symbol(dc)?;
            self.bits.take(u32::from(length).min(16));
            return self.coefficients(ac, 1, 63, &mut 0);
        }
        match (self.band.first, self.band.refined, nonzero) {
            (0, true, _) => self.bits.take(1),
            (0, false, _) => {
                let length = self.symbol(dc)?;
                self.bits.take(u32::from(length).min(16))
            }
            (_, _, None) => return Err(Fault::Damaged),
            (first, false, Some(nonzero)) => {
                return match self.run.checked_sub(1) {
                    Some(run) => {
                        self.run = run;
                        Ok(())
                    }
                    None => self.coefficients(ac, first, self.band.last, nonzero),
                };
            }
            (first, true, Some(nonzero)) => return self.refine(ac, first, nonzero),
        };
        Ok(())
    }

    fn symbol(&mut self, code: Option<&Code>) -> Result<u8, Fault> {
        let [length, symbol] = code.map_or([0, 0], |code| code.0[self.bits.peek16()]);
        if length == 0 {
            let ended = self.bits.exhausted();
            return Err(if ended { Fault::Truncated } else { Fault::Damaged });
        }
        self.bits.take(u32::from(length));
        Ok(symbol)
    }

    /// The length of a run of blocks that ends with this one.
    fn run_of(&mut self, exponent: u8) -> u32 {
        (1 << exponent) + self.bits.take(u32::from(exponent))
    }

    fn coefficients(
        &mut self,
        code: Option<&Code>,
        first: u32,
        last: u32,
        nonzero: &mut u64,
    ) -> Result<(), Fault> {
        let mut at = first;
        while at <= last {
            let symbol = self.symbol(code)?;
            let (zeros, length) = (symbol >> 4, symbol & 15);
            match (zeros, length) {
                (15, 0) => at += 16,
                (exponent, 0) => {
                    if self.band.progressive {
                        self.run = self.run_of(exponent) - 1;
                    }
                    return Ok(());
                }
                (zeros, length) => {
                    at += u32::from(zeros);
                    if at > last {
                        return Err(if self.bits.exhausted() { Fault::Truncated } else { Fault::Damaged });
                    }
                    self.bits.take(u32::from(length));
                    *nonzero |= 1 << at;
                    at += 1;
                }
            }
        }
        Ok(())
    }

    fn refine(&mut self, code: Option<&Code>, first: u32, nonzero: &mut u64) -> Result<(), Fault> {
        let last = self.band.last;
        let mut at = first;
        if self.run == 0 {
            while at <= last {
                let symbol = self.symbol(code)?;
                let (mut zeros, length) = (symbol >> 4, symbol & 15);
                if length == 0 && zeros < 15 {
                    self.run = self.run_of(zeros);
                    break;
                }
                if length > 0 {
                    self.bits.take(1);
                }
                while at <= last {
                    if *nonzero >> at & 1 == 1 {
                        self.bits.take(1);
                    } else if zeros == 0 {
                        if length > 0 {
                            *nonzero |= 1 << at;
                        }
                        at += 1;
                        break;
                    } else {
                        zeros -= 1;
                    }
                    at += 1;
                }
            }
        }
        if self.run > 0 {
            self.run -= 1;
            let remaining = (*nonzero >> at.min(63)) << at.min(63) & (u64::MAX >> (63 - last));
            if at <= last {
                for _ in 0..remaining.count_ones() {
                    self.bits.take(1);
                }
            }
        }
        Ok(())
    }

    /// What follows the scan, from its next marker on.
    fn end(mut self, data: &'b [u8]) -> Result<&'b [u8], Fault> {
        if self.bits.overdrawn() {
            return Err(Fault::Truncated);
        }
        loop {
            self.left += self.bits.align();
            let rest = self.bits.rest();
            match rest {
                [0xff, 0xd0..=0xd7, after @ ..] => self.bits = Bits::new(after),
                _ => {
                    let used = data.len() - rest.len();
                    let whole = self.left <= FEW || (self.left as f64) < MOST_LEFT * used as f64;
                    return if whole { Ok(rest) } else { Err(Fault::Damaged) };
                }
            }
        }
    }
}

/// The bits of entropy-coded data up to the next marker; zeros from there on.
struct Bits<'b> {
    bytes: &'b [u8],
    held: u64,
    count: u32,
    /// Bits among those held that are behind the end.
    added: u32,
}

impl<'b> Bits<'b> {
    fn new(bytes: &'b [u8]) -> Self {
        Self { bytes, held: 0, count: 0, added: 0 }
    }

    fn fill(&mut self) {
        while self.count <= 48 {
            let byte = match self.bytes {
                [0xff, 0x00, after @ ..] => {
                    self.bytes = after;
                    0xff
                }
                [0xff, 0xff, ..] => {
                    self.bytes = &self.bytes[1..];
                    continue;
                }
                [] | [0xff, ..] => {
                    self.added += 8;
                    0
                }
                [byte, after @ ..] => {
                    self.bytes = after;
                    *byte
                }
            };
            self.held = self.held << 8 | u64::from(byte);
            self.count += 8;
        }
    }

    fn peek16(&mut self) -> usize {
        if self.count < 16 {
            self.fill();
        }
        (self.held >> (self.count - 16)) as usize & 0xffff
    }

    fn take(&mut self, bits: u32) -> u32 {
        if self.count < bits {
            self.fill();
        }
        self.count -= bits;
        ((self.held >> self.count) & ((1 << bits) - 1)) as u32
    }

    /// Whether more bits were taken than there are.
    fn overdrawn(&self) -> bool {
        self.added > self.count + MISSING_BITS
    }

    /// Whether the next bit is behind the end.
    fn exhausted(&self) -> bool {
        self.added >= self.count
    }

    /// Goes to the next marker; the number of whole bytes up to it.
    fn align(&mut self) -> usize {
        let held = self.count.saturating_sub(self.added) / 8;
        let marker = |pair: &[u8]| pair[0] == 0xff && pair[1] != 0x00 && pair[1] != 0xff;
        let skipped = self.bytes.windows(2).position(marker).unwrap_or(self.bytes.len());
        self.bytes = &self.bytes[skipped..];
        (self.held, self.count, self.added) = (0, 0, 0);
        held as usize + skipped
    }

    fn rest(&self) -> &'b [u8] {
        self.bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// JPEGs of the same picture: baseline, with other sampling, with restart markers, progressive, grey.
    fn images() -> Vec<Vec<u8>> {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/fixtures/jpeg");
        let mut names: Vec<_> =
            std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
        names.sort();
        assert!(names.len() >= 6);
        names.into_iter().map(|path| std::fs::read(path).unwrap()).collect()
    }

    #[test]
    fn whole_images_pass_and_every_cut_is_found() {
        for bytes in images() {
            assert_eq!(check(&bytes), Ok(()));
            let begin = bytes.windows(2).position(|pair| pair == [0xff, 0xda]).unwrap() + 20;
            for share in [0.05, 0.3, 0.6, 0.9, 0.97] {
                let cut = begin + ((bytes.len() - begin) as f64 * share) as usize;
                let mut ended = bytes[..cut].to_vec();
                assert!(check(&ended).is_err());
                ended.extend([0xff, 0xd9]);
                assert!(check(&ended).is_err(), "cut at {share}");
                let mut zeroed = bytes.clone();
                zeroed[cut..].fill(0);
                zeroed.extend([0xff, 0xd9]);
                assert!(check(&zeroed).is_err(), "zeros from {share}");
            }
        }
    }

    #[test]
    fn a_second_frame_is_damage_whatever_its_size() {
        // Progressive, 65500x65500, 255 components: 137 GB of blocks.
        let mut second = vec![0xff, 0xc2, 0x03, 0x05, 8, 0xff, 0xdc, 0xff, 0xdc, 255];
        second.extend((0..=254).flat_map(|id| [id, 0x11, 0]));
        for mut bytes in images() {
            let end = bytes.len() - 2;
            bytes.splice(end..end, second.clone());
            assert_eq!(check(&bytes), Err(Fault::Damaged));
        }
        let alone = [&[0xff, 0xd8], &*second, &[0xff, 0xd9]].concat();
        assert_eq!(check(&alone), Ok(()), "left to the decoder, which refuses it");
    }

    #[test]
    fn any_bytes_are_read_without_a_panic() {
        for bytes in images() {
            let mut state = 1_u32;
            for _ in 0..400 {
                let mut changed = bytes.clone();
                for _ in 0..4 {
                    state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    let at = (state >> 8) as usize % changed.len();
                    changed[at] = state as u8;
                }
                let _ = check(&changed);
            }
        }
    }
}

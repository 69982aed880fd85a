//! DEFLATE decompression (RFC 1951), bounded by the size that the archive states.

use super::Parsed;

const MAX_BITS: usize = 15;
const LENGTH_BASE: [u16; 29] = [
    3, 4, 5, 6, 7, 8, 9, 10, 11, 13, 15, 17, 19, 23, 27, 31, 35, 43, 51, 59, 67, 83, 99, 115, 131, 163, 195,
    227, 258,
];
const LENGTH_EXTRA: [u8; 29] =
    [0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3, 4, 4, 4, 4, 5, 5, 5, 5, 0];
const DISTANCE_BASE: [u16; 30] = [
    1, 2, 3, 4, 5, 7, 9, 13, 17, 25, 33, 49, 65, 97, 129, 193, 257, 385, 513, 769, 1025, 1537, 2049, 3073,
    4097, 6145, 8193, 12289, 16385, 24577,
];
const DISTANCE_EXTRA: [u8; 30] =
    [0, 0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5, 6, 6, 7, 7, 8, 8, 9, 9, 10, 10, 11, 11, 12, 12, 13, 13];
const CODE_LENGTH_ORDER: [usize; 19] = [16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15];

/// Decompresses `data`; an error if it is broken or gives more than `limit` bytes.
pub(super) fn inflate(data: &[u8], limit: usize) -> Parsed<Vec<u8>> {
    run(data, limit)
        .ok_or_else(|| "the compressed data is broken or truncated; write the file again".to_owned())
}

fn run(data: &[u8], limit: usize) -> Option<Vec<u8>> {
    let mut bits = Bits { data, position: 0, buffer: 0, count: 0 };
    let mut out = Vec::new();
    loop {
        let last = bits.take(1)?;
        match bits.take(2)? {
            0 => stored(&mut bits, &mut out, limit)?,
            1 => {
                let (literals, distances) = fixed_codes()?;
                block(&mut bits, &mut out, limit, &literals, &distances)?;
            }
            2 => {
                let (literals, distances) = dynamic_codes(&mut bits)?;
                block(&mut bits, &mut out, limit, &literals, &distances)?;
            }
            _ => return None,
        }
        if last == 1 {
            return Some(out);
        }
    }
}

struct Bits<'a> {
    data: &'a [u8],
    position: usize,
    buffer: u32,
    count: u32,
}

impl Bits<'_> {
    /// The next `n <= 16` bits, the first the least significant.
    fn take(&mut self, n: u32) -> Option<u16> {
        while self.count < n {
            self.buffer |= u32::from(*self.data.get(self.position)?) << self.count;
            self.position += 1;
            self.count += 8;
        }
        let value = self.buffer & ((1 << n) - 1);
        self.buffer >>= n;
        self.count -= n;
        Some(value as u16)
    }
}

/// A canonical Huffman code: how many codes there are of each length, and the symbols in code order.
struct Code {
    counts: [u16; MAX_BITS + 1],
    symbols: Vec<u16>,
}

impl Code {
    fn new(lengths: &[u8]) -> Option<Self> {
        let mut counts = [0_u16; MAX_BITS + 1];
        for &length in lengths {
            *counts.get_mut(usize::from(length))? += 1;
        }
        counts[0] = 0;
        let (mut offsets, mut left) = ([0_u16; MAX_BITS + 2], 1_i32);
        for length in 1..=MAX_BITS {
            left = 2 * left - i32::from(counts[length]);
            if left < 0 {
                return None;
            }
            offsets[length + 1] = offsets[length] + counts[length];
        }
        let mut symbols = vec![0; lengths.len()];
        for (symbol, &length) in lengths.iter().enumerate().filter(|(_, length)| **length > 0) {
            let offset = &mut offsets[usize::from(length)];
            *symbols.get_mut(usize::from(*offset))? = symbol as u16;
            *offset += 1;
        }
        Some(Self { counts, symbols })
    }

    fn decode(&self, bits: &mut Bits<'_>) -> Option<u16> {
        let (mut code, mut first, mut index) = (0_i32, 0_i32, 0_i32);
        for &count in &self.counts[1..] {
            code |= i32::from(bits.take(1)?);
            let count = i32::from(count);
            if code - count < first {
                return self.symbols.get(usize::try_from(index + code - first).ok()?).copied();
            }
            index += count;
            first = (first + count) << 1;
            code <<= 1;
        }
        None
    }
}

fn fixed_codes() -> Option<(Code, Code)> {
    let mut lengths = [8_u8; 288];
    lengths[144..256].fill(9);
    lengths[256..280].fill(7);
    Some((Code::new(&lengths)?, Code::new(&[5; 30])?))
}

fn dynamic_codes(bits: &mut Bits<'_>) -> Option<(Code, Code)> {
    let literals = usize::from(bits.take(5)?) + 257;
    let distances = usize::from(bits.take(5)?) + 1;
    let given = usize::from(bits.take(4)?) + 4;
    let mut lengths = [0_u8; 19];
    for &symbol in CODE_LENGTH_ORDER.iter().take(given) {
        lengths[symbol] = bits.take(3)? as u8;
    }
    let code = Code::new(&lengths)?;
    let mut lengths = Vec::with_capacity(320);
    while lengths.len() < literals + distances {
        let (value, times) = match code.decode(bits)? {
            symbol @ 0..=15 => (symbol as u8, 1),
            16 => (*lengths.last()?, 3 + bits.take(2)?),
            17 => (0, 3 + bits.take(3)?),
            _ => (0, 11 + bits.take(7)?),
        };
        lengths.extend(std::iter::repeat_n(value, usize::from(times)));
    }
    if lengths.len() != literals + distances {
        return None;
    }
    let (literals, distances) = lengths.split_at(literals);
    Some((Code::new(literals)?, Code::new(distances)?))
}

fn stored(bits: &mut Bits<'_>, out: &mut Vec<u8>, limit: usize) -> Option<()> {
    // Fewer than 8 bits wait in the buffer: they pad up to the next byte.
    (bits.buffer, bits.count) = (0, 0);
    let length = bits.take(16)?;
    if bits.take(16)? != !length {
        return None;
    }
    let chunk = bits.data.get(bits.position..bits.position + usize::from(length))?;
    if out.len() + chunk.len() > limit {
        return None;
    }
    out.extend_from_slice(chunk);
    bits.position += chunk.len();
    Some(())
}

fn block(
    bits: &mut Bits<'_>,
    out: &mut Vec<u8>,
    limit: usize,
    literals: &Code,
    distances: &Code,
) -> Option<()> {
    loop {
        let symbol = literals.decode(bits)?;
        if symbol == 256 {
            return Some(());
        }
        if symbol < 256 {
            out.push(symbol as u8);
        } else {
            let length = with_extra(bits, &LENGTH_BASE, &LENGTH_EXTRA, symbol - 257)?;
            let symbol = distances.decode(bits)?;
            let distance = with_extra(bits, &DISTANCE_BASE, &DISTANCE_EXTRA, symbol)?;
            let start = out.len().checked_sub(distance)?;
            // The copy may run into its own output, so it goes byte by byte.
            for from in start..start + length {
                out.push(*out.get(from)?);
            }
        }
        if out.len() > limit {
            return None;
        }
    }
}

fn with_extra(bits: &mut Bits<'_>, base: &[u16], extra: &[u8], symbol: u16) -> Option<usize> {
    let index = usize::from(symbol);
    Some(usize::from(*base.get(index)?) + usize::from(bits.take(u32::from(*extra.get(index)?))?))
}

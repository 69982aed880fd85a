use std::str::FromStr;

/// A part of many scenes or photographs, by their names alone: part `index` of `count`, from 1, which is written `2/8`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    index: u32,
    count: u32,
}

impl Shard {
    /// The most parts that a run can have.
    const MOST: u32 = 1_000_000;

    /// Whether the item of this name belongs to it: the CRC-32 of the name modulo the number of shards.
    pub fn has(&self, name: &str) -> bool {
        crc32fast::hash(name.as_bytes()) % self.count == self.index - 1
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let part = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
        let known = part.filter(|(index, count)| (1..=*count).contains(index) && *count <= Self::MOST);
        let (index, count) = known.ok_or("give I/N with I from 1 to N, such as 2/8")?;
        Ok(Self { index, count })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_is_in_one_shard() {
        let shards = [1, 2, 3, 4].map(|index| Shard { index, count: 4 });
        let counts =
            shards.map(|shard| (0..1000).filter(|number| shard.has(&format!("IMG_{number:04}"))).count());
        assert_eq!(counts.iter().sum::<usize>(), 1000);
        assert!(counts.iter().all(|count| (150..350).contains(count)), "{counts:?}");
    }
}

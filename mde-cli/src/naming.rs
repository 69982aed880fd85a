//! How messages name arguments.

/// Who gives the arguments that messages name: a command line or a function's caller.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Naming {
    /// `--max-memory`.
    #[default]
    Flags,
    /// `max_memory`.
    Keywords,
}

impl Naming {
    /// An argument, such as `max-memory`.
    pub fn of(self, name: &str) -> String {
        match self {
            Self::Flags => format!("--{name}"),
            Self::Keywords => name.replace('-', "_"),
        }
    }

    /// One of two texts, where the arguments differ in more than their spelling.
    pub fn choose<'t>(self, flags: &'t str, keywords: &'t str) -> &'t str {
        match self {
            Self::Flags => flags,
            Self::Keywords => keywords,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_a_flag_or_a_keyword() {
        assert_eq!(Naming::Flags.of("max-memory"), "--max-memory");
        assert_eq!(Naming::Keywords.of("max-memory"), "max_memory");
    }
}

//! The exit codes: other programs rely on them.

use std::process::ExitCode;

/// What `--help` says about them.
pub const HELP: &str = "\
Exit codes:
  0    all well
  1    internal error
  2    usage or configuration
  3    some mesh could not be processed
  4    some eigenpair failed its verification
  130  interrupted; finished work is kept
When several apply: 130, then 1, 3, 4.";

/// What `--help` says after the options: how a command is used, and how it ends.
pub fn help(examples: &str) -> String {
    format!("Examples:\n  {}\n\n{HELP}", examples.trim_start())
}

/// How a command ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Exit {
    /// All well.
    Success,
    /// A defect of this program, or of the system.
    Internal,
    /// Wrong usage or configuration.
    Usage,
    /// Some mesh could not be processed.
    MeshFailed,
    /// Some eigenpair failed its verification.
    Unverified,
    /// Interrupted; finished work is kept.
    Interrupted,
}

impl Exit {
    /// The code.
    pub fn code(self) -> u8 {
        match self {
            Self::Success => 0,
            Self::Internal => 1,
            Self::Usage => 2,
            Self::MeshFailed => 3,
            Self::Unverified => 4,
            Self::Interrupted => 130,
        }
    }

    /// The one that counts when several apply.
    pub fn gravest(exits: impl IntoIterator<Item = Self>) -> Self {
        exits.into_iter().max_by_key(|exit| exit.gravity()).unwrap_or(Self::Success)
    }

    fn gravity(self) -> u8 {
        match self {
            Self::Success => 0,
            Self::Unverified => 1,
            Self::MeshFailed => 2,
            Self::Internal => 3,
            Self::Usage => 4,
            Self::Interrupted => 5,
        }
    }
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit.code())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interruption_outranks_all_and_a_failed_mesh_outranks_a_failed_pair() {
        use Exit::*;
        assert_eq!(Exit::gravest([Unverified, Interrupted, Internal]), Interrupted);
        assert_eq!(Exit::gravest([Unverified, MeshFailed, Internal]), Internal);
        assert_eq!(Exit::gravest([Unverified, MeshFailed]), MeshFailed);
        assert_eq!(Exit::gravest([]), Success);
    }
}

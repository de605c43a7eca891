//! What this program's code is, module by module: hashes that the build script takes of the sources.

include!(concat!(env!("OUT_DIR"), "/fingerprints.rs"));

/// Hash of every source file that `module`, a path like `module_path!()` gives it, can reach, of all dependencies'
/// versions, and of the compiler. For a module that the build script does not know, of all files.
pub fn of(module: &str) -> &'static str {
    let name = module.split("::").nth(1).unwrap_or_default();
    MODULES
        .iter()
        .find(|(known, _)| *known == name)
        .map_or(ALL, |(_, hash)| hash)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modules_have_fingerprints_of_their_own() {
        let encode = of("cairn_bake::encode::bc7");
        assert_eq!(encode, of("cairn_bake::encode"));
        assert_ne!(encode, of("cairn_bake::prepare"));
        assert_ne!(encode, ALL);
        assert_eq!(of("cairn_bake::no_such_module"), ALL);
        assert_eq!(of("cairn_bake"), ALL);
    }

    #[test]
    fn every_module_is_known() {
        let library = include_str!("../lib.rs");
        let modules = library
            .lines()
            .filter_map(|line| line.trim_start_matches("pub ").strip_prefix("mod "))
            .map(|line| line.trim_end_matches(';'));
        for module in modules {
            assert!(
                MODULES.iter().any(|(known, _)| *known == module),
                "{module}"
            );
        }
    }
}

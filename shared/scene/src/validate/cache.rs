//! Changes of the cache's limit.

use crate::limits::POSITIVE;
use crate::plan::CacheChangePlan;
use crate::source::{SceneError, Source, key};
use crate::typed::CacheChangeTyped;
use std::sync::Arc;

/// Checks the changes: one after the other, none above what is reserved at the start, which the
/// command line may have changed.
pub(super) fn cache_changes(
    source: &Source,
    typed: &[CacheChangeTyped],
    most: usize,
) -> Result<Arc<[CacheChangePlan]>, SceneError> {
    let mut last_s = 0.0;
    let changes = typed.iter().map(|change| {
        let at_s = source.required(key!(change.at_s), POSITIVE)?;
        if at_s <= last_s {
            return Err(source.value(
                &change.at_s,
                &format!("at_s is {at_s}, not after the change before; write the changes in their order in time"),
            ));
        }
        last_s = at_s;
        let bytes = change.bytes.get_ref().0;
        if bytes > most {
            return Err(source.value(
                &change.bytes,
                &format!("{bytes} bytes are more than the {most} that are reserved at the start; raise bytes of [cache] (--cache lies over it) or lower this"),
            ));
        }
        Ok(CacheChangePlan { at_s, bytes })
    });
    changes.collect()
}

#[cfg(test)]
mod tests {
    use crate::files::NoFiles;
    use crate::plan::{CacheChangePlan, Overrides, ScenePlan};
    use crate::source::SceneError;
    use crate::validate::parse;
    use std::path::Path;

    fn plan(cache: &str) -> Result<ScenePlan, SceneError> {
        plan_with(cache, None)
    }

    /// Under the command line's `--cache`.
    fn plan_with(cache: &str, bytes: Option<&str>) -> Result<ScenePlan, SceneError> {
        let overrides = Overrides {
            cache: bytes.map(str::to_owned),
            ..Overrides::default()
        };
        let text = format!(
            "[[object]]\nmodel = \"a.spm\"\nsize_m = 0.1\n[[probe]]\n[cache]\nbytes = \"8MiB\"\n{cache}"
        );
        parse(&text, "scene", Path::new(""), &overrides, &NoFiles)
    }

    /// The scene's own 8 MiB say nothing then.
    #[test]
    fn the_limit_changes_within_what_the_command_line_reserves() {
        let change = |bytes: &str| format!("[[cache.change]]\nat_s = 1\nbytes = \"{bytes}\"\n");
        let more = plan_with(&change("16MiB"), Some("32MiB")).unwrap();
        assert_eq!(more.cache_bytes, 32 << 20);
        assert_eq!(more.cache_changes[0].bytes, 16 << 20);
        let error = plan_with(&change("4MiB"), Some("2MiB")).unwrap_err().0;
        assert!(
            error.contains("line 9: 4194304 bytes are more than the 2097152"),
            "{error}"
        );
    }

    #[test]
    fn the_limit_changes_in_order_within_what_is_reserved() {
        let good = "[[cache.change]]\nat_s = 1.5\nbytes = \"2MiB\"\n\
                    [[cache.change]]\nat_s = 3.0\nbytes = \"8MiB\"\n";
        let expected = [(1.5, 2 << 20), (3.0, 8 << 20)];
        let expected = expected.map(|(at_s, bytes)| CacheChangePlan { at_s, bytes });
        assert_eq!(*plan(good).unwrap().cache_changes, expected);
        assert!(plan("").unwrap().cache_changes.is_empty());
        for (bad, says) in [
            (
                "[[cache.change]]\nat_s = 1\nbytes = \"9MiB\"\n",
                "line 9: 9437184 bytes are more than",
            ),
            (
                "[[cache.change]]\nat_s = 0\nbytes = \"1MiB\"\n",
                "line 8: at_s",
            ),
            (
                "[[cache.change]]\nat_s = 2\nbytes = \"1MiB\"\n[[cache.change]]\nat_s = 2\nbytes = \"1MiB\"\n",
                "line 11: at_s is 2, not after",
            ),
        ] {
            let error = plan(bad).unwrap_err().0;
            assert!(error.contains(says), "{error}");
        }
    }
}

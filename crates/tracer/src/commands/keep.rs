//! What a file says of the coefficients that were kept, among its options.

use wrt_core::Keep;

/// The name of that option.
pub(super) const KEEP: &str = "keep";

/// What is kept, in words.
pub(super) fn text(keep: Keep) -> String {
    match keep {
        Keep::RelativeError(error) => format!("relative error {error}"),
        Keep::Count(count) => format!("{count} coefficients"),
    }
}

/// The option as it is in a file, in words: earlier files have it as the program's own name
/// for it, `RelativeError(0.002)`.
pub(super) fn in_words(said: &str) -> String {
    let of = |name: &str| said.strip_prefix(name)?.strip_prefix('(')?.strip_suffix(')');
    let error = of("RelativeError").and_then(|x| x.parse().ok()).map(Keep::RelativeError);
    let count = of("Count").and_then(|n| n.parse().ok()).map(Keep::Count);
    error.or(count).map_or_else(|| said.to_owned(), text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_earlier_files_say_is_put_into_words() {
        for keep in [Keep::RelativeError(0.002), Keep::RelativeError(1e-7), Keep::Count(64)] {
            assert_eq!(in_words(&format!("{keep:?}")), text(keep));
            assert_eq!(in_words(&text(keep)), text(keep));
        }
        assert_eq!(in_words("RelativeError(much)"), "RelativeError(much)");
    }
}

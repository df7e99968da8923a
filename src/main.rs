//! The `glowtree` program: parse the command line, run one verb, print its report, leave with its exit code.

fn main() -> std::process::ExitCode {
    glowtree::cli::main()
}

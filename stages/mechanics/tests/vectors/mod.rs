mod file;
mod shell;

mod file;
mod plant;
mod shell;

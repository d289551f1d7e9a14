mod contact;
mod dynamics;
mod file;
mod plant;
mod shell;

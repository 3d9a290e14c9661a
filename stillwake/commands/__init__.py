"""The commands, one file for each group. Their folder is below the folder of `__main__`, so that no file hides a
package that has the file's name."""

"""What somebody who helps wants to see, in one file, without anything secret."""

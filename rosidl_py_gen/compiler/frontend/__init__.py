"""Front end of the compiler: from definition files to checked interfaces."""
